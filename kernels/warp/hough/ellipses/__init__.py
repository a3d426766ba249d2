"""Ellipses, in Warp."""
