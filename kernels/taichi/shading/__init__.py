"""Kernels of shading in Taichi."""
