"""Cases of dense stereo."""
