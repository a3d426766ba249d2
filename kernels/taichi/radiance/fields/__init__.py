"""Fields, in Taichi."""
