"""Training, in Warp."""
