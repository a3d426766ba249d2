"""Panoramas, in Warp."""
