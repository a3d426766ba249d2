"""Gaussian splats: where they begin, how they are relocated, and their files."""
