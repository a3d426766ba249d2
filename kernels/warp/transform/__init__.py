"""Geometric transforms in Warp."""
