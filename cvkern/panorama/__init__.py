"""Panoramas: which images of a heap belong together, and what they make together."""

from cvkern.panorama.recognition import Recognition, recognize_panoramas
from cvkern.panorama.stitching import Panorama, stitch

__all__ = ["Panorama", "Recognition", "recognize_panoramas", "stitch"]
