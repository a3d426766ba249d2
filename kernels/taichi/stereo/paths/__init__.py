"""Semi-global matching, in Taichi."""
