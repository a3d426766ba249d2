"""Classical computer vision and radiance fields as data-parallel kernels."""

from cvkern._capture import capture
from cvkern._runtime import use
from cvkern.circle_centers import Circles, detect_circles
from cvkern.circles import CirclePeaks, hough_circle, hough_circle_peaks
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
from cvkern.ellipse_detection import Ellipses, detect_ellipses
from cvkern.ellipses import EllipseVotes, hough_ellipse
from cvkern.filters import box, correlate_separable, gaussian
from cvkern.gradients import Gradient, gradient, scharr, sobel
from cvkern.line_peaks import HoughLinePeaks, hough_line_peaks
from cvkern.lines import (
    HoughLine,
    HoughLineSlope,
    LineBins,
    hough_line,
    hough_line_slope,
    suggest_line_bins,
)
from cvkern.rank import median
from cvkern.segments import (
    LineFit,
    detect_lines,
    detect_segments,
    fit_line,
    hough_line_segments,
)
from cvkern.semi_global import Winner, aggregate_semi_global, winner_take_all
from cvkern.shape_tables import RTable, r_table
from cvkern.shapes import Shapes, find_shape, generalized_hough, generalized_hough_votes
from cvkern.stereo import StereoMatcher, StereoResult, stereo_match
from cvkern.stereo_cost import stereo_cost

__all__ = [
    "CirclePeaks",
    "Circles",
    "EllipseVotes",
    "Ellipses",
    "Gradient",
    "HoughLine",
    "HoughLinePeaks",
    "HoughLineSlope",
    "LineBins",
    "LineFit",
    "PointCloud",
    "RTable",
    "Shapes",
    "StereoMatcher",
    "StereoResult",
    "SubpixelEdges",
    "Winner",
    "aggregate_semi_global",
    "box",
    "canny",
    "capture",
    "correlate_separable",
    "detect_circles",
    "detect_ellipses",
    "detect_lines",
    "detect_segments",
    "disparity_to_depth",
    "fill_disparity",
    "find_shape",
    "fit_line",
    "gaussian",
    "generalized_hough",
    "generalized_hough_votes",
    "gradient",
    "guided_median",
    "hough_circle",
    "hough_circle_peaks",
    "hough_ellipse",
    "hough_line",
    "hough_line_peaks",
    "hough_line_segments",
    "hough_line_slope",
    "left_right_check",
    "median",
    "point_cloud",
    "points_from_disparity",
    "r_table",
    "remove_speckles",
    "reprojection_matrix",
    "scharr",
    "sobel",
    "stereo_cost",
    "stereo_match",
    "subpixel_edges",
    "suggest_line_bins",
    "use",
    "winner_take_all",
]
__version__ = "0.1.0"
