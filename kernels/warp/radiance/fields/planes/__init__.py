"""Fields of parallel planes, in Warp."""
