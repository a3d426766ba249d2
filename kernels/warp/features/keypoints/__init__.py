"""Keypoints of a scale space, in Warp."""
