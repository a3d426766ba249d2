"""Demosaicing, in Taichi."""
