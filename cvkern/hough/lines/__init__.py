"""Lines and segments by voting."""

from cvkern.hough.lines.peaks import HoughLinePeaks, hough_line_peaks
from cvkern.hough.lines.progressive import probabilistic_hough_line
from cvkern.hough.lines.segments import (
    LineFit,
    detect_lines,
    detect_segments,
    fit_line,
    hough_line_segments,
)
from cvkern.hough.lines.votes import (
    HoughLine,
    HoughLineSlope,
    LineBins,
    hough_line,
    hough_line_slope,
    suggest_line_bins,
)

__all__ = [
    "HoughLine",
    "HoughLinePeaks",
    "HoughLineSlope",
    "LineBins",
    "LineFit",
    "detect_lines",
    "detect_segments",
    "fit_line",
    "hough_line",
    "hough_line_peaks",
    "hough_line_segments",
    "hough_line_slope",
    "probabilistic_hough_line",
    "suggest_line_bins",
]
