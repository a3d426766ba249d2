"""Circles, in Warp."""
