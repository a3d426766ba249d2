"""Structured light, in Taichi."""
