"""Classical computer vision and radiance fields as data-parallel kernels."""

from cvkern._capture import capture
from cvkern._runtime import use
from cvkern.circles import CirclePeaks, hough_circle, hough_circle_peaks
from cvkern.edges import SubpixelEdges, canny, subpixel_edges
from cvkern.filters import box, correlate_separable, gaussian
from cvkern.gradients import Gradient, gradient, scharr, sobel
from cvkern.rank import median

__all__ = [
    "CirclePeaks",
    "Gradient",
    "SubpixelEdges",
    "box",
    "canny",
    "capture",
    "correlate_separable",
    "gaussian",
    "gradient",
    "hough_circle",
    "hough_circle_peaks",
    "median",
    "scharr",
    "sobel",
    "subpixel_edges",
    "use",
]
__version__ = "0.1.0"
