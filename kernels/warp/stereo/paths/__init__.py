"""Semi-global matching, in Warp."""
