"""Classical computer vision and radiance fields as data-parallel kernels."""

from cvkern._runtime import use
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
    "box",
    "correlate_separable",
    "gaussian",
    "gradient",
    "median",
    "scharr",
    "sobel",
    "use",
]
__version__ = "0.1.0"
