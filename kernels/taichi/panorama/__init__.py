"""Panoramas, in Taichi."""
