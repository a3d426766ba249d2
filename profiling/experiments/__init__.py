"""Questions that a measurement answers, one program each."""
