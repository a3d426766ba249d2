"""Perceptrons, in Taichi."""
