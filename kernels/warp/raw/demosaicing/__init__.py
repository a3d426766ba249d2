"""Demosaicing, in Warp."""
