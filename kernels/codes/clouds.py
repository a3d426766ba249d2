"""Codes of pictures of point clouds."""

# Pictures of points: the key of a sample that shows none, and the most samples across a point.
FAR = 2**63 - 1
LARGEST_SPLAT = 64.0
