"""The condensed sequential convex method."""
