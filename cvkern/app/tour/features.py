"""Features: keypoints, matches, and a sheet seen from the front."""

from __future__ import annotations

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images.drawing import draw_circles, draw_lines

COLOUR = (255, 98, 41)
MATRIX = np.array([[0.86, 0.3, 30.0], [-0.22, 0.92, 120.0], [1e-4, 2.5e-4, 1.0]])
SIDEWAYS = np.array(
    [[0.9, 0.2, 20.0], [0.1, 1.0, 20.0], [4e-4, 2e-4, 1.0]]
)  # how the sheet is seen
SHOWN = 120  # matches that are drawn
NEAR = 3.0  # pixels that a right match may be off


def chapter() -> Chapter:
    """Return the chapter on features."""
    return Chapter(
        "features",
        "Keypoints",
        "Some points of a photograph can be found again in another one of the same scene, from "
        "elsewhere, nearer or turned. Each is described by numbers that change little.",
        (_points, _matches, _plane),
    )


def _points(clock: Clock) -> Figure:
    from skimage import data

    photo = data.camera()
    found = clock(cvkern.sift, photo, 400)
    corners = cvkern.orb(photo, 400)
    panels = []
    for name, points, text in (
        ("features-sift", found, "SIFT: blobs of all sizes, the circles show their scales"),
        ("features-orb", corners, "ORB: corners in eight sizes of the photograph"),
    ):
        factor = 3.0 if points is found else 5.0
        circles = np.column_stack((points.points, factor * points.scales))
        drawn = draw_circles(photo, circles, color=COLOUR)
        panels.append(Panel(name, drawn, text))
    return Figure(
        "Points that can be found again",
        "SIFT smooths the photograph more and more, and keeps the points where the difference of "
        "two levels is extreme among all neighbours in place and scale. ORB keeps corners: pixels "
        "with nine neighbours of a circle that are all brighter or all darker.",
        "points, scales, orientations, responses, descriptors = cvkern.sift(photo, 400)\n"
        "corners = cvkern.orb(photo, 400)",
        tuple(panels),
        clock.take(),
    )


def _matches(clock: Clock) -> Figure:
    from skimage import data

    photo = data.camera()
    seen = cvkern.warp_perspective(photo, MATRIX, mode="nearest", dtype=np.uint8)
    one, other = cvkern.sift(photo, 1000), cvkern.sift(seen, 1000)
    matches = clock(cvkern.match_descriptors, one.descriptors, other.descriptors, 0.8)
    table = np.hstack((one.points[matches[:, 0]], other.points[matches[:, 1]]))
    there = np.c_[table[:, 1::-1], np.ones(len(table))] @ MATRIX.T
    off = np.hypot(*(there[:, :2] / there[:, 2:] - table[:, :1:-1]).T)
    both = np.hstack((photo, seen))
    drawn = table[:: max(1, len(table) // SHOWN)] + np.array([0, 0, 0, photo.shape[1]])
    return Figure(
        "The same points in two pictures",
        f"The right picture is the left one through a homography. {len(table)} points are matched: "
        "each is the nearest of the other by its 128 numbers, and clearly nearer than the second. "
        f"{int((off < NEAR).sum())} of them lie within {NEAR:g} pixels of where the homography "
        "has them. Distances are whole numbers, so that every device finds the same matches.",
        "matches = cvkern.match_descriptors(one.descriptors, other.descriptors, 0.8)",
        (Panel("features-matches", draw_lines(both, drawn, color=COLOUR, width=1.0),
               f"{len(drawn)} of the matches"),),
        clock.take(),
    )  # fmt: skip


def _plane(clock: Clock) -> Figure:
    from skimage import data

    photo = data.text()
    seen = cvkern.warp_perspective(photo, SIDEWAYS, (260, 480), cval=90, dtype=np.uint8)
    height, width = photo.shape
    ends = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]])
    places = np.c_[ends, np.ones(4)] @ SIDEWAYS.T
    corners = (places[:, :2] / places[:, 2:])[:, ::-1]
    front = clock(cvkern.rectify_plane, seen, corners, photo.shape, dtype=np.uint8)
    sides = np.hstack((corners, np.roll(corners, -1, axis=0)))
    return Figure(
        "A sheet from the front",
        "Four corners tell the homography of a sheet; through its inverse the sheet is seen from "
        "the front. The map and the sampling are one kernel.",
        "front = cvkern.rectify_plane(photo, corners, (172, 448))",
        (
            Panel("features-sheet", draw_lines(seen, sides, color=COLOUR, width=2.0),
                  "The sheet, seen from the side"),
            Panel("features-front", front, "The same from the front"),
        ),
        clock.take(),
    )  # fmt: skip
