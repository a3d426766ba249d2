"""Depth from normals, in Taichi."""
