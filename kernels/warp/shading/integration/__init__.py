"""Depth from normals, in Warp."""
