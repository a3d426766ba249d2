"""Ellipses, in Taichi."""
