"""Radiance fields, in Warp."""
