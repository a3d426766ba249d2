"""Cases of panoramas."""
