"""Jobs, where they run, and in which order."""
