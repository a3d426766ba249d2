"""Posed photographs, read from folders or rendered by the library itself."""
