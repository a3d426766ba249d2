"""Posed photographs, read from folders or made by the library itself."""
