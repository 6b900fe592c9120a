"""What people see: figures, verdict tables, one HTML file. Degrees and kilometres live here."""
