"""Geometry of one and two views: maps between images, robust fits to matches with outliers."""

from cvkern.geometry.epipolar import (
    epipolar_lines,
    epipoles,
    find_fundamental,
    find_fundamentals,
    fit_fundamental,
    sampson_distance,
)
from cvkern.geometry.fitting import fit_affine, fit_homography, fit_similarity
from cvkern.geometry.maps import (
    find_affine,
    find_homographies,
    find_homography,
    find_similarity,
)
from cvkern.geometry.robust import RobustFit, RobustFits

__all__ = [
    "RobustFit",
    "RobustFits",
    "epipolar_lines",
    "epipoles",
    "find_affine",
    "find_fundamental",
    "find_fundamentals",
    "find_homographies",
    "find_homography",
    "find_similarity",
    "fit_affine",
    "fit_fundamental",
    "fit_homography",
    "fit_similarity",
    "sampson_distance",
]
