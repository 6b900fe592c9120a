"""Sequential convex programming: one optimal control problem → one Trajectory."""
