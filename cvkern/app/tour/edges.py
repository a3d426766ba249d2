"""Edges: scales, orientation, sub-pixel positions."""

from __future__ import annotations

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images.colors import apply_colormap, luma
from cvkern.images.drawing import draw_lines, draw_points

SCALES = (1, 2, 4)
QUANTILES = {"low_threshold": 0.7, "high_threshold": 0.9, "use_quantiles": True}
COINS = {"sigma": 2, "low_threshold": 64, "high_threshold": 128}
CROP = (slice(22, 50), slice(332, 369))
ZOOM = 26
COLOUR = (255, 98, 41)


def chapter() -> Chapter:
    """Return the chapter on edges."""
    return Chapter(
        "edges",
        "Edges",
        "Brightness changes where objects end. Derivatives of a Gaussian find the change, thinning "
        "keeps its crest, and hysteresis keeps the parts that are connected.",
        (_scales, _orientation, _subpixel),
    )


def _scales(clock: Clock) -> Figure:
    from skimage import data

    photo = data.chelsea()
    gray = luma(photo)
    panels = [Panel("edges-scales-photograph", photo, "The photograph, `skimage.data.chelsea()`")]
    for sigma in SCALES:
        edges = clock(cvkern.canny, gray, sigma=sigma, **QUANTILES)
        label = f"`sigma={sigma}`: {edges.sum():,} edge pixels"
        panels.append(Panel(f"edges-scales-sigma-{sigma}", _ink(edges), label, ink=True))
    return Figure(
        "One photograph, three scales",
        "The width of the Gaussian decides what counts as an edge. At one pixel the fur and the "
        "whiskers are edges; at four, only eyes, nose and outline are left. The thresholds are "
        "quantiles of the gradient, so they need no change from scale to scale.",
        "gray = luma(photo)\n"
        "for sigma in (1, 2, 4):\n"
        "    edges = cvkern.canny(\n"
        "        gray, sigma, low_threshold=0.7,\n"
        "        high_threshold=0.9, use_quantiles=True,\n"
        "    )",
        tuple(panels),
        clock.take(),
    )


def _orientation(clock: Clock) -> Figure:
    from skimage import data

    photo = data.coffee()
    gradient = clock(cvkern.gradient, luma(photo), sigma=2)
    colours = apply_colormap(gradient.orientation, "cyclic")
    bright = gradient.magnitude / np.quantile(gradient.magnitude, 0.985)
    shown = np.round(colours * bright.clip(0, 1)[..., None] ** 0.7).astype(np.uint8)
    return Figure(
        "The direction of change",
        "Hue shows the direction in which the photograph gets brighter, and brightness shows how "
        "fast. Around a cup the hues run once through the circle; the two sides of a thin line "
        "have opposite hues.",
        "gradient = cvkern.gradient(luma(photo), sigma=2)\n"
        'colours = apply_colormap(gradient.orientation, "cyclic")\n'
        "# shown darker where gradient.magnitude is small",
        (
            Panel("edges-orientation-photograph", photo, "The photograph, `skimage.data.coffee()`"),
            Panel("edges-orientation", shown, "Orientation as hue, magnitude as brightness"),
            Panel(
                "edges-orientation-key",
                _wheel(),
                "The key: the photograph gets brighter in this direction, seen from the centre.",
                small=True,
            ),
        ),
        clock.take(),
    )


def _subpixel(clock: Clock) -> Figure:
    from skimage import data

    photo = data.coins()
    edges = clock(cvkern.canny, photo, **COINS, operator="gaussian")
    found = clock(cvkern.subpixel_edges, photo, **COINS)
    enlarged = np.kron(photo[CROP], np.ones((ZOOM, ZOOM), np.uint8))
    mask = np.kron(edges[CROP], np.ones((ZOOM, ZOOM), bool))
    stairs = np.repeat(enlarged[..., None], 3, axis=2)
    stairs[mask] = (0.35 * stairs[mask] + 0.65 * np.array(COLOUR)).astype(np.uint8)
    # A pixel centre is an integer, so pixel 0 reaches from -0.5 to 0.5.
    places = (found.points - (CROP[0].start, CROP[1].start) + 0.5) * ZOOM - 0.5
    normal = np.stack((np.sin(found.orientation), np.cos(found.orientation)), axis=1)
    needles = np.hstack((places, places + 0.9 * ZOOM * normal))
    lines = draw_lines(enlarged, needles, color=COLOUR, width=2.5)
    lines = draw_points(lines, places, color=COLOUR, radius=6.0)
    return Figure(
        "Edges with sub-pixel positions",
        "The rim of a coin, each pixel drawn as a square. A mask only says which pixels the edge "
        "crosses. A sub-pixel edge says where: each dot is the crest of the gradient, and its "
        "needle points to the brighter side.",
        "points, orientation, strength = cvkern.subpixel_edges(\n"
        "    photo, sigma=2, low_threshold=64, high_threshold=128,\n"
        ")",
        (
            Panel("edges-subpixel-mask", stairs, "`canny`: whole pixels", pixelated=True),
            Panel("edges-subpixel-points", lines, "`subpixel_edges`: points and normals"),
        ),
        clock.take(),
    )


def _ink(mask: np.ndarray) -> np.ndarray:
    return np.where(mask, np.uint8(20), np.uint8(255))


def _wheel(size: int = 228) -> np.ndarray:
    """Return a ring of the cyclic colours on a transparent background, (size, size, 4)."""
    y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
    radius = np.hypot(y, x)
    colours = apply_colormap(np.arctan2(y, x), "cyclic")
    inside = np.minimum(0.5 * size - 1 - radius, radius - 0.28 * size) + 0.5
    return np.dstack((colours, np.round(255 * inside.clip(0, 1)).astype(np.uint8)))
