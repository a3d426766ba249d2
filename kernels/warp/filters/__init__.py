"""Filters, in Warp."""
