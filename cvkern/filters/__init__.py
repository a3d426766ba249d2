"""Linear filters, gradients, the median, and a threshold."""

from cvkern.filters.gradients import Gradient, gradient
from cvkern.filters.linear import box, correlate_separable, gaussian
from cvkern.filters.medians import median
from cvkern.filters.operators import laplace, prewitt, scharr, sobel, sobel_h, sobel_v
from cvkern.filters.thresholds import threshold_otsu

__all__ = [
    "Gradient",
    "box",
    "correlate_separable",
    "gaussian",
    "gradient",
    "laplace",
    "median",
    "prewitt",
    "scharr",
    "sobel",
    "sobel_h",
    "sobel_v",
    "threshold_otsu",
]
