"""Recognition, in Taichi."""
