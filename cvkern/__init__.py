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
from cvkern.disparity import (
    fill_disparity,
    guided_median,
    left_right_check,
    remove_speckles,
)
from cvkern.edges import SubpixelEdges, canny, subpixel_edges
from cvkern.filters import box, correlate_separable, gaussian
from cvkern.gradients import Gradient, gradient, scharr, sobel
from cvkern.rank import median
from cvkern.semi_global import Winner, aggregate_semi_global, winner_take_all
from cvkern.stereo import StereoMatcher, StereoResult, stereo_match
from cvkern.stereo_cost import stereo_cost

__all__ = [
    "Gradient",
    "PointCloud",
    "StereoMatcher",
    "StereoResult",
    "SubpixelEdges",
    "Winner",
    "aggregate_semi_global",
    "box",
    "canny",
    "capture",
    "correlate_separable",
    "disparity_to_depth",
    "fill_disparity",
    "gaussian",
    "gradient",
    "guided_median",
    "left_right_check",
    "median",
    "point_cloud",
    "points_from_disparity",
    "remove_speckles",
    "reprojection_matrix",
    "scharr",
    "sobel",
    "stereo_cost",
    "stereo_match",
    "subpixel_edges",
    "use",
    "winner_take_all",
]
__version__ = "0.1.0"
