"""Cases of edges."""
