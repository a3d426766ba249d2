"""Keypoints of a scale space, in Taichi."""
