"""Questions answered by measurement, one program each."""
