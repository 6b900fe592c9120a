"""Physics as fast functions with derivatives."""
