"""Circles, in Taichi."""
