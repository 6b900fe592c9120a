"""In which order cases are solved, and from where."""
