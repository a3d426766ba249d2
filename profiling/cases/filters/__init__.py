"""Cases of filters."""
