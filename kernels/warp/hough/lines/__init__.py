"""Lines, in Warp."""
