"""Marching of rays, in Taichi."""
