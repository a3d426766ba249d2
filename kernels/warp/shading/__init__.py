"""Kernels of shading in Warp."""
