"""The generalised Hough transform, in Taichi."""
