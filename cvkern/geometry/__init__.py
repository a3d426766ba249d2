"""Geometry of one and two views: maps between images, robust fits to matches with outliers."""

from cvkern.geometry.fitting import fit_affine, fit_homography, fit_similarity

__all__ = [
    "fit_affine",
    "fit_homography",
    "fit_similarity",
]
