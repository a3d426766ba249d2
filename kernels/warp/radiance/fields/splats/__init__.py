"""Gaussian splats, in Warp."""
