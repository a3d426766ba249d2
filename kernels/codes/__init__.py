"""Codes that kernels switch on and constants, by family, for the API and both kernel sets."""
