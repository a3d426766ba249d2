"""Dense stereo, in Warp."""
