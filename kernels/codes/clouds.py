"""Codes of pictures of point clouds."""

# The key of a sample that shows no point, and the largest number of samples across a point.
FAR = 2**63 - 1
LARGEST_SPLAT = 64.0
