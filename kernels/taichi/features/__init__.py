"""Features in Taichi."""
