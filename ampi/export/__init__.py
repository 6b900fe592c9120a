"""Writers of flight code: they read the row layout and the table."""
