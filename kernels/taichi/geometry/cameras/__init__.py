"""Kernels of cameras, in Taichi."""
