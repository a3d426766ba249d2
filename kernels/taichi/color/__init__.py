"""Colour, in Taichi."""
