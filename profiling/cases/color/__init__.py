"""Cases of colour."""
