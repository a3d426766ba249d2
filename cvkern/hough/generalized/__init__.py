"""The generalised Hough transform: arbitrary shapes, rotated and scaled."""

from cvkern.hough.generalized.detection import detect_shape
from cvkern.hough.generalized.tables import RTable, r_table
from cvkern.hough.generalized.votes import Shapes, generalized_hough, generalized_hough_votes

__all__ = [
    "RTable",
    "Shapes",
    "detect_shape",
    "generalized_hough",
    "generalized_hough_votes",
    "r_table",
]
