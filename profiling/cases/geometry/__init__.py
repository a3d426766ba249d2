"""Cases of geometry."""
