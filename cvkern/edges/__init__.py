"""Edges, as a mask of pixels or as points with sub-pixel positions."""

from cvkern.edges.masks import canny
from cvkern.edges.subpixel import SubpixelEdges, subpixel_edges

__all__ = ["SubpixelEdges", "canny", "subpixel_edges"]
