"""Corners, keypoints with descriptors, and their matching."""

from cvkern.features.binary import orb
from cvkern.features.corners import (
    corner_harris,
    corner_peaks,
    corner_shi_tomasi,
    corner_subpix,
)
from cvkern.features.keypoints import Features, sift
from cvkern.features.matching import match_descriptors, match_images

__all__ = [
    "Features",
    "corner_harris",
    "corner_peaks",
    "corner_shi_tomasi",
    "corner_subpix",
    "match_descriptors",
    "match_images",
    "orb",
    "sift",
]
