"""Cases of raw pictures."""
