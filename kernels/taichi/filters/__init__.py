"""Filters, in Taichi."""
