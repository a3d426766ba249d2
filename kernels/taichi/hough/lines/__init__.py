"""Lines, in Taichi."""
