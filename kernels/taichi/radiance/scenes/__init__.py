"""Synthetic scenes, in Taichi."""
