"""Kernels of cameras, in Warp."""
