"""Circles by voting."""

from cvkern.hough.circles.detection import Circles, detect_circles
from cvkern.hough.circles.peaks import CirclePeaks, hough_circle_peaks
from cvkern.hough.circles.votes import hough_circle

__all__ = ["CirclePeaks", "Circles", "detect_circles", "hough_circle", "hough_circle_peaks"]
