"""Radiance fields, one module each."""
