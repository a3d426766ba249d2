"""Cases of recognition."""
