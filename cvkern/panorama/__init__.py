"""Panoramas: grouping of an unordered set of images, and stitching of each group."""

from cvkern.panorama.recognition import Recognition, recognize_panoramas
from cvkern.panorama.stitching import Panorama, stitch

__all__ = ["Panorama", "Recognition", "recognize_panoramas", "stitch"]
