"""Structured light, in Warp."""
