"""Edges, in Taichi."""
