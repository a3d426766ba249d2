"""Hough transforms, in Warp."""
