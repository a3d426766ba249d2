"""Cases of features."""
