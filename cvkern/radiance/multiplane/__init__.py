"""Multiplane images: their first texels, and their files."""
