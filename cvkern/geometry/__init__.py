"""Geometry of one and two views: maps between images, robust fits to matches with outliers."""

from cvkern.geometry.cameras.calibration import Calibration, calibrate_camera, chessboard_points
from cvkern.geometry.cameras.calibration_files import read_calibration, write_calibration
from cvkern.geometry.cameras.chessboards import detect_chessboard
from cvkern.geometry.cameras.lens import Camera, project_points, undistort_points
from cvkern.geometry.cameras.rectification import Rectification, RectifiedPair, rectify_stereo
from cvkern.geometry.cameras.stereo_calibration import StereoCalibration, calibrate_stereo
from cvkern.geometry.cameras.undistortion import undistort
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
    "Calibration",
    "Camera",
    "FoundPose",
    "PlanePose",
    "Planes",
    "RecoveredPose",
    "Rectification",
    "RectifiedPair",
    "RectifyingMaps",
    "RobustFit",
    "RobustFits",
    "StereoCalibration",
    "calibrate_camera",
    "calibrate_stereo",
    "chessboard_points",
    "detect_chessboard",
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
    "project_points",
    "read_calibration",
    "recover_pose",
    "rectify_stereo",
    "rectify_uncalibrated",
    "sampson_distance",
    "triangulate",
    "undistort",
    "undistort_points",
    "write_calibration",
]
