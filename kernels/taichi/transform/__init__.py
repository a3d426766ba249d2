"""Geometric transforms in Taichi."""
