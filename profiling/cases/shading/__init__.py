"""Cases of shading."""
