"""Hough transforms: lines, segments, circles, ellipses and arbitrary shapes."""

from cvkern.hough.circles import (
    CirclePeaks,
    Circles,
    detect_circles,
    hough_circle,
    hough_circle_peaks,
)
from cvkern.hough.ellipses import Ellipses, EllipseVotes, detect_ellipses, hough_ellipse
from cvkern.hough.generalized import (
    RTable,
    Shapes,
    detect_shape,
    generalized_hough,
    generalized_hough_votes,
    r_table,
)
from cvkern.hough.lines import (
    HoughLine,
    HoughLinePeaks,
    HoughLineSlope,
    LineBins,
    LineFit,
    detect_lines,
    detect_segments,
    fit_line,
    hough_line,
    hough_line_peaks,
    hough_line_segments,
    hough_line_slope,
    suggest_line_bins,
)

__all__ = [
    "CirclePeaks",
    "Circles",
    "EllipseVotes",
    "Ellipses",
    "HoughLine",
    "HoughLinePeaks",
    "HoughLineSlope",
    "LineBins",
    "LineFit",
    "RTable",
    "Shapes",
    "detect_circles",
    "detect_ellipses",
    "detect_lines",
    "detect_segments",
    "detect_shape",
    "fit_line",
    "generalized_hough",
    "generalized_hough_votes",
    "hough_circle",
    "hough_circle_peaks",
    "hough_ellipse",
    "hough_line",
    "hough_line_peaks",
    "hough_line_segments",
    "hough_line_slope",
    "r_table",
    "suggest_line_bins",
]
