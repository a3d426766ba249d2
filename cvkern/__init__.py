"""Classical computer vision and radiance fields as data-parallel kernels."""

from cvkern._capture import capture
from cvkern._runtime import use
from cvkern.depth import (
    PointCloud,
    disparity_to_depth,
    point_cloud,
    points_from_disparity,
    reprojection_matrix,
)
from cvkern.edges import SubpixelEdges, canny, subpixel_edges
from cvkern.filters import box, correlate_separable, gaussian
from cvkern.gradients import Gradient, gradient, scharr, sobel
from cvkern.rank import median
from cvkern.semi_global import Winner, aggregate_semi_global, winner_take_all
from cvkern.stereo_cost import stereo_cost

__all__ = [
    "Gradient",
    "PointCloud",
    "SubpixelEdges",
    "Winner",
    "aggregate_semi_global",
    "box",
    "canny",
    "capture",
    "correlate_separable",
    "disparity_to_depth",
    "gaussian",
    "gradient",
    "median",
    "point_cloud",
    "points_from_disparity",
    "reprojection_matrix",
    "scharr",
    "sobel",
    "stereo_cost",
    "subpixel_edges",
    "use",
    "winner_take_all",
]
__version__ = "0.1.0"
