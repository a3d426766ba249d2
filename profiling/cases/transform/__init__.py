"""Cases of geometric transforms."""
