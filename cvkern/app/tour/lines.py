"""Lines: votes, what noise does to them, lines and segments."""

from __future__ import annotations

import math

import numpy as np

import cvkern
from cvkern.app.tour import line_noise
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images._overlay import across
from cvkern.images.colors import apply_colormap, luma
from cvkern.images.drawing import draw_lines

COLOUR = (255, 98, 41)
NARROW = math.radians(3)


def chapter() -> Chapter:
    """Return the chapter on lines."""
    return Chapter(
        "lines",
        "Lines",
        "Every edge point votes for all lines through it, or only for the line across its "
        "gradient. Where many votes meet, there is a line.",
        (_votes, _noise, _lines, _segments),
    )


def _votes(clock: Clock) -> Figure:
    from skimage import data

    photo = data.camera()
    edges = cvkern.canny(photo, 1.5)
    plain = clock(cvkern.hough_line, edges)
    directed = cvkern.hough_line(
        edges,
        orientation=cvkern.gradient(photo, sigma=1.5).orientation,
        orientation_tolerance=NARROW,
    )
    return Figure(
        "A line is where votes meet",
        "Each edge point draws a wave in the votes. The angle of the line's normal increases from "
        "left to right, over half a turn; its distance from top to bottom. The waves of points on "
        "a line cross in one place: the bright spots are the legs of the tripod. With its "
        "gradient, a point votes for six or seven angles instead of 180, and only the spots stay.",
        "edges = cvkern.canny(photo, 1.5)\n"
        "votes, theta, rho = cvkern.hough_line(edges)\n"
        "directed = cvkern.hough_line(\n"
        "    edges, orientation=cvkern.gradient(photo, sigma=1.5).orientation,\n"
        "    orientation_tolerance=np.radians(3),\n"
        ")",
        (
            Panel("lines-votes-edges", np.where(edges, np.uint8(20), np.uint8(255)),
                  f"{edges.sum():,} edge points of `skimage.data.camera()`", ink=True),
            Panel("lines-votes-plain", _shown(plain.votes), "Votes of all points at all angles"),
            Panel("lines-votes-directed", _shown(directed.votes),
                  "Votes within 3 degrees of the gradient"),
        ),
        clock.take(),
    )  # fmt: skip


def _noise(clock: Clock) -> Figure:
    return Figure(
        "What noise does to a peak",
        f"{line_noise.POINTS} points of a line among {line_noise.CLUTTER} others. Left: noise "
        "spreads the votes of the line over neighbouring bins, and lowers its peak. Middle: the "
        "lead over the highest bin elsewhere matters more. Smoothing along rho lowers the peak, "
        "but helps if the noise is about a pixel or more; voting across the gradient is best "
        "throughout. Right, with half a pixel of noise: narrow bins split the peak, so that "
        "chance peaks reach half of it; wide bins collect votes of other points. "
        "`suggest_line_bins` gives 1.4.",
        "cvkern.hough_line(points=points, shape=(256, 256))\n"
        "cvkern.gaussian(votes, (1.5, 0))  # smoothed\n"
        "cvkern.hough_line(\n"
        "    points=points, shape=(256, 256),\n"
        "    orientation=orientation, orientation_tolerance=np.radians(6),\n"
        ")",
        (
            Panel(
                "lines-noise",
                line_noise.plot(),
                "Height of the peak and its lead against noise; false peaks against bin size",
            ),
        ),
        clock.take(),
    )


def _lines(clock: Clock) -> Figure:
    from skimage import data

    photo = data.brick()
    found = clock(cvkern.detect_lines, photo, sigma=2.0, min_votes=150)
    return Figure(
        "Lines, to a fraction of a pixel",
        "Sub-pixel edges vote, each peak is fitted to the edge points near it, and the others vote "
        "again. Each joint of the wall is found as a pair of edges.",
        "votes, theta, rho = cvkern.detect_lines(photo, sigma=2, min_votes=150)",
        (
            Panel("lines-lines-photograph", photo, "The photograph, `skimage.data.brick()`"),
            Panel(
                "lines-lines",
                draw_lines(photo, across(found.theta, found.rho, photo.shape), color=COLOUR),
                f"{len(found.rho)} lines with at least 150 edge points",
            ),
        ),
        clock.take(),
    )


def _segments(clock: Clock) -> Figure:
    from skimage import data

    photo = data.rocket()
    gray = luma(photo)
    found = clock(cvkern.detect_segments, gray, sigma=1.0, low_threshold=12, high_threshold=24)
    return Figure(
        "Segments",
        "A line has no ends; a segment ends with its edge. Along the line of each peak, points "
        "that follow one another without a gap make a segment.",
        "segments = cvkern.detect_segments(\n"
        "    luma(photo), sigma=1, low_threshold=12, high_threshold=24,\n"
        ")",
        (
            Panel("lines-segments-photograph", photo, "The photograph, `skimage.data.rocket()`"),
            Panel(
                "lines-segments",
                draw_lines(photo, found, color=COLOUR, width=2.0),
                f"{len(found)} segments of 10 pixels or more",
            ),
        ),
        clock.take(),
    )


def _shown(votes: np.ndarray) -> np.ndarray:
    """Return votes as a picture: angles three times as wide, distances half as high."""
    bright = np.sqrt(votes / max(int(votes.max()), 1))
    return np.repeat(apply_colormap(bright, "sequential"), 3, axis=1)[::2]
