"""Recognition, in Warp."""
