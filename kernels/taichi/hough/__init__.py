"""Hough transforms, in Taichi."""
