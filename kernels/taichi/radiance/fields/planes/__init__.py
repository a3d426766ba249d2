"""Fields of parallel planes, in Taichi."""
