"""Training, in Taichi."""
