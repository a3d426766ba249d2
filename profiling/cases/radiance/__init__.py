"""Cases of radiance fields."""
