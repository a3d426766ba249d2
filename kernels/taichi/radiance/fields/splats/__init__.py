"""Gaussian splats, in Taichi."""
