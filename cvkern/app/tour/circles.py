"""Circles and ellipses: the coins of a photograph, the votes for them, the rim of a cup."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images.colors import apply_colormap, luma
from cvkern.images.drawing import draw_circles, draw_lines

COLOR, RIM = (255, 98, 41), (64, 220, 255)
RADIUS = 22  # pixels: radius of the coins whose votes are shown
CUP = (85, 200)


def chapter() -> Chapter:
    """Return the chapter on circles."""
    return Chapter(
        "circles",
        "Circles and ellipses",
        "The gradient at a point of a rim points to the centre. Where many such lines meet, there "
        "is a circle, even if half of its rim is hidden.",
        (_coins, _accumulators, _ellipse),
    )


def _coins(clock: Clock) -> Figure:
    from skimage import data

    photo = data.coins()
    found = clock(cvkern.detect_circles, photo, radius_range=(15, 40))
    rings = np.column_stack((found.centers, found.radii))
    return Figure(
        "Coins",
        f"{len(rings)} circles with sub-pixel accuracy: centres from the votes along the gradient, "
        "radii from the points that aim at a centre, then a least-squares fit. The visible share "
        f"of a rim is between {found.support.min():.0%} and {found.support.max():.0%}.",
        "circles = cvkern.detect_circles(photo, (15, 40))\n"
        "circles.centers, circles.radii, circles.support",
        (
            Panel("circles-photograph", photo, "The photograph, `skimage.data.coins()`"),
            Panel(
                "circles-coins",
                draw_circles(photo, rings, color=COLOR, width=2.0),
                "The circles that were found",
            ),
        ),
        clock.take(),
    )


def _accumulators(clock: Clock) -> Figure:
    from skimage import data

    photo = data.coins()
    mask = cvkern.canny(photo, 2, 32, 64)
    orientation = cvkern.gradient(photo, sigma=2).orientation
    plain = clock(cvkern.hough_circle, mask, radius=RADIUS)[0]

    def hough_circle(mask: np.ndarray, **options: Any) -> np.ndarray:
        return cvkern.hough_circle(mask, orientation=orientation, **options)

    directed = clock(hough_circle, mask, radius=RADIUS, orientation_tolerance=0.15)[0]
    return Figure(
        "Votes for one radius",
        f"Each edge pixel votes for all centres that are {RADIUS} pixels away; coins of that size "
        "stand out from a haze. With the gradient, it votes only for two short arcs, and the haze "
        "disappears.",
        f"votes = cvkern.hough_circle(mask, {RADIUS})\n"
        "votes = cvkern.hough_circle(\n"
        f"    mask, {RADIUS}, orientation=gradient.orientation,\n"
        "    orientation_tolerance=0.15,\n"
        ")",
        (
            Panel("circles-edges", np.where(mask, np.uint8(20), np.uint8(255)),
                  f"{mask.sum():,} edge pixels", ink=True),
            Panel("circles-votes", apply_colormap(plain), "Votes all round"),
            Panel("circles-directed", apply_colormap(directed), "Votes along the gradient"),
        ),
        clock.take(),
    )  # fmt: skip


def _ellipse(clock: Clock) -> Figure:
    from skimage import data

    photo = data.coffee()
    found = clock(cvkern.detect_ellipses, luma(photo), axis_range=CUP, low_threshold=24,
                  high_threshold=48)  # fmt: skip
    shown = photo
    for center, axes, turn in zip(found.centers, found.axes, found.orientation, strict=True):
        shown = draw_lines(shown, _outline(center, axes, float(turn)), color=RIM, width=2.5)
    (major, minor), turn = found.axes[0], float(np.degrees(found.orientation[0]))
    return Figure(
        "The rim of a cup",
        "Two points of the rim whose gradients lie along the line between them are taken as the "
        "ends of a major axis; all others vote for the minor axis. The best ellipse is fitted to "
        f"the points near it: semi-axes of {major:.1f} and {minor:.1f} pixels, rotated by "
        f"{turn:.1f} degrees.",
        "ellipses = cvkern.detect_ellipses(\n"
        f"    luma(photo), {CUP}, low_threshold=24, high_threshold=48,\n"
        ")",
        (
            Panel("circles-coffee", photo, "The photograph, `skimage.data.coffee()`"),
            Panel("circles-ellipse", shown, f"{found.support[0]:.0%} of the rim is visible"),
        ),
        clock.take(),
    )


def _outline(center: np.ndarray, axes: np.ndarray, turn: float) -> np.ndarray:
    """Return segments along an ellipse, (N, 4)."""
    t = np.linspace(0, 2 * np.pi, 241)
    u, v = axes[0] * np.cos(t), axes[1] * np.sin(t)
    sine, cosine = np.sin(turn), np.cos(turn)
    places = np.stack((center[0] + u * sine + v * cosine, center[1] + u * cosine - v * sine), 1)
    return np.hstack((places[:-1], places[1:]))
