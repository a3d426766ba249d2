"""Geometry of one and two views: maps between images, robust fits to matches with outliers."""

from cvkern.geometry.epipolar import (
    epipolar_lines,
    epipoles,
    find_fundamental,
    find_fundamentals,
    fit_fundamental,
    sampson_distance,
)
from cvkern.geometry.essential import find_essential, find_essentials
from cvkern.geometry.fitting import fit_affine, fit_homography, fit_similarity
from cvkern.geometry.maps import (
    find_affine,
    find_homographies,
    find_homography,
    find_similarity,
)
from cvkern.geometry.planes import Planes, find_planes
from cvkern.geometry.poses import FoundPose, PlanePose, find_pose, pose_from_homography
from cvkern.geometry.robust import RobustFit, RobustFits
from cvkern.geometry.uncalibrated import RectifyingMaps, rectify_uncalibrated
from cvkern.geometry.views import (
    RecoveredPose,
    essential_from_fundamental,
    recover_pose,
    triangulate,
)

__all__ = [
    "FoundPose",
    "PlanePose",
    "Planes",
    "RecoveredPose",
    "RectifyingMaps",
    "RobustFit",
    "RobustFits",
    "epipolar_lines",
    "epipoles",
    "essential_from_fundamental",
    "find_affine",
    "find_essential",
    "find_essentials",
    "find_fundamental",
    "find_fundamentals",
    "find_homographies",
    "find_homography",
    "find_planes",
    "find_pose",
    "find_similarity",
    "fit_affine",
    "fit_fundamental",
    "fit_homography",
    "fit_similarity",
    "pose_from_homography",
    "recover_pose",
    "rectify_uncalibrated",
    "sampson_distance",
    "triangulate",
]
