"""Two photographs: matches, rectification, and a depth for each pixel."""

from __future__ import annotations

import numpy as np

import cvkern
from cvkern.app.commands.pair import pictures
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images.drawing import draw_epipolar_lines, draw_points

FOCAL, COLUMNS, ROW, BASELINE = 994.978, (311.193, 342.279), 254.877, 0.193  # pixels, metres
TURN = 0.15  # turn of the second camera about its axis, radians
TWELVE = 12  # points whose lines are drawn


def chapter() -> Chapter:
    """Return the chapter on pairs of photographs."""
    return Chapter(
        "pair",
        "Two photographs",
        "Two photographs of a scene, from different places, tell how the camera moved, and then "
        "how far away each pixel is.",
        (_lines, _depth),
    )


def _photographs() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a pair, the second one as if the camera had been turned, and both cameras."""
    from skimage import data

    left, right, _ = data.stereo_motorcycle()
    cameras = [np.array([[FOCAL, 0, c], [0, FOCAL, ROW], [0, 0, 1]]) for c in COLUMNS]
    c, s = np.cos(TURN), np.sin(TURN)
    turn = cameras[1] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.linalg.inv(cameras[1])
    turned = cvkern.warp_perspective(right, turn, right.shape[:2], channel_axis=-1, dtype=np.uint8)
    return left, turned, np.stack(cameras)


def _lines(clock: Clock) -> Figure:
    left, right, _ = _photographs()
    gray = [cvkern.images.luma(photo) for photo in (left, right)]
    one, other = (cvkern.sift(g, 2000, data_range=255) for g in gray)
    pairs = cvkern.match_descriptors(one.descriptors, other.descriptors, 0.8)
    a, b = one.points[pairs[:, 0]], other.points[pairs[:, 1]]
    fit = clock(cvkern.find_fundamental, a, b)
    assert fit.matrix is not None
    good = np.flatnonzero(fit.inliers)
    shown = good[:: max(1, len(good) // TWELVE)][:TWELVE]
    turns = 2 * np.pi * np.arange(len(shown)) / max(len(shown), 1)
    colors = 140 + 115 * np.stack([np.cos(turns + k) for k in (0, 2.1, 4.2)], 1)
    lines = draw_epipolar_lines(right, fit.matrix, a[shown], color=colors)
    return Figure(
        "Points and their lines",
        f"{len(pairs)} keypoints are matched, {len(good)} of them agree on one fundamental matrix: "
        "a point of the left photograph lies on a line in the right one, wherever it is in space. "
        "The right camera was turned for this picture.",
        "fit = cvkern.find_fundamental(points0, points1)\n"
        "draw_epipolar_lines(right, fit.matrix, points0)",
        (
            Panel("pair-points", draw_points(left, a[shown], color=colors, radius=6.0), "Points"),
            Panel("pair-lines", draw_points(lines, b[shown], color=colors, radius=6.0),
                  "Their lines, and the same points"),
        ),
        clock.take(),
    )  # fmt: skip


def _depth(clock: Clock) -> Figure:
    left, right, cameras = _photographs()
    found = clock(cvkern.reconstruct_pair, left, right, cameras, BASELINE)
    level, sparse, dense = pictures(found)
    near, far = np.nanquantile(found.depth, (0.01, 0.99))
    return Figure(
        "From two photographs to depth",
        "Homographies turn both photographs so that matches lie on one row. Keypoints give "
        f"{len(found.points)} exact points; matching every pixel gives {found.valid.mean():.0%} of "
        f"the picture a depth, here from {near:.1f} to {far:.1f} metres.",
        "pair = cvkern.reconstruct_pair(left, right, cameras, baseline=0.193)",
        (
            Panel("pair-rectified", level, "Rectified: the rows meet"),
            Panel("pair-sparse", sparse, "Sparse: keypoints, bright where near"),
            Panel("pair-dense", dense, "Dense: every pixel, in the same colours"),
        ),
        clock.take(),
    )
