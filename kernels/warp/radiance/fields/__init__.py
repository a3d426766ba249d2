"""Fields, in Warp."""
