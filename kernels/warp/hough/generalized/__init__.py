"""The generalised Hough transform, in Warp."""
