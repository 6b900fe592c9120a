"""What is on disk before the file."""
