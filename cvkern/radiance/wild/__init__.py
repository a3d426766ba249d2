"""Photographs of changing light and crowds."""
