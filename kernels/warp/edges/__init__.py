"""Edges, in Warp."""
