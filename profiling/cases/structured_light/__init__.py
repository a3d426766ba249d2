"""Cases of structured light."""
