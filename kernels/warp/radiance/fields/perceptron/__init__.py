"""Perceptrons, in Warp."""
