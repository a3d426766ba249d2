"""Corners, keypoints with descriptors, and their matching."""

from cvkern.features.keypoints import Features, sift
from cvkern.features.matching import match_descriptors, match_images

__all__ = ["Features", "match_descriptors", "match_images", "sift"]
