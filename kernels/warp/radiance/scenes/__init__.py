"""Synthetic scenes, in Warp."""
