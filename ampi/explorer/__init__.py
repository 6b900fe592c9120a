"""The explorer: one HTML file in which a table, its flights and wrong models are moved by hand."""
