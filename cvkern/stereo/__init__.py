"""Dense stereo: from a rectified pair to disparities, depth and points."""

from cvkern.stereo.costs import stereo_cost
from cvkern.stereo.depth import (
    PointCloud,
    disparity_to_depth,
    point_cloud,
    points_from_disparity,
    reprojection_matrix,
)
from cvkern.stereo.matching import StereoResult, stereo_match
from cvkern.stereo.paths import aggregate_semi_global
from cvkern.stereo.reconstruction import PairReconstruction, reconstruct_pair
from cvkern.stereo.refinement import (
    fill_disparity,
    guided_median,
    left_right_check,
    remove_speckles,
)
from cvkern.stereo.videos import DepthFrame, StereoMatcher
from cvkern.stereo.winners import Winner, winner_take_all

__all__ = [
    "DepthFrame",
    "PairReconstruction",
    "PointCloud",
    "StereoMatcher",
    "StereoResult",
    "Winner",
    "aggregate_semi_global",
    "disparity_to_depth",
    "fill_disparity",
    "guided_median",
    "left_right_check",
    "point_cloud",
    "points_from_disparity",
    "reconstruct_pair",
    "remove_speckles",
    "reprojection_matrix",
    "stereo_cost",
    "stereo_match",
    "winner_take_all",
]
