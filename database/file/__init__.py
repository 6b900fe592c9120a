"""Blocks, and the file they are merged into."""
