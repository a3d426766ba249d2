"""Dense stereo, in Taichi."""
