"""Marching of rays, in Warp."""
