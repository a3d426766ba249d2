"""Geometry of one and two views in Taichi."""
