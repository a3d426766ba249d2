"""Linear filters, gradients and the median."""

from cvkern.filters.gradients import Gradient, gradient, prewitt, scharr, sobel
from cvkern.filters.linear import box, correlate_separable, gaussian
from cvkern.filters.medians import median

__all__ = [
    "Gradient",
    "box",
    "correlate_separable",
    "gaussian",
    "gradient",
    "median",
    "prewitt",
    "scharr",
    "sobel",
]
