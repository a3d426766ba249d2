"""Matching costs, in Warp."""
