"""Codes of options, and constants, by family, shared by the API and both kernel sets."""
