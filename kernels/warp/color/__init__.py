"""Colour, in Warp."""
