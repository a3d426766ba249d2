"""Ellipses by voting."""

from cvkern.hough.ellipses.detection import Ellipses, detect_ellipses
from cvkern.hough.ellipses.votes import EllipseVotes, hough_ellipse

__all__ = ["EllipseVotes", "Ellipses", "detect_ellipses", "hough_ellipse"]
