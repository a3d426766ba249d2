"""Raw pictures, in Taichi."""
