"""Panoramas: grouping of an unordered set of images, and stitching of each group."""

from cvkern.panorama.photographs import PhotographMatches, match_photographs
from cvkern.panorama.recognition import Recognition, recognize_panoramas
from cvkern.panorama.stitching import Panorama, stitch

__all__ = [
    "Panorama",
    "PhotographMatches",
    "Recognition",
    "match_photographs",
    "recognize_panoramas",
    "stitch",
]
