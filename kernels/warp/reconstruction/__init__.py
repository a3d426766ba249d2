"""Reconstruction, in Warp."""
