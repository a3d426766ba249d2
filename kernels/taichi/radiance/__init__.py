"""Radiance fields, in Taichi."""
