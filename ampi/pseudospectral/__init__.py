"""Flipped Radau nodes, barycentric evaluation and meshes of phases and segments."""
