"""Matching costs, in Taichi."""
