"""Features in Warp."""
