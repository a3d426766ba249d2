"""Classical computer vision and radiance fields as data-parallel kernels."""

from cvkern._runtime import use
from cvkern.edges import SubpixelEdges, canny, subpixel_edges
from cvkern.filters import (
    Gradient,
    box,
    correlate_separable,
    gaussian,
    gradient,
    median,
    scharr,
    sobel,
)

__all__ = [
    "Gradient",
    "SubpixelEdges",
    "box",
    "canny",
    "correlate_separable",
    "gaussian",
    "gradient",
    "median",
    "scharr",
    "sobel",
    "subpixel_edges",
    "use",
]
__version__ = "0.1.0"
