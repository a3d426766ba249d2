"""Reconstruction, in Taichi."""
