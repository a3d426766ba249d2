"""Maps between points of two images, and what follows from them."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    Call,
    Draw,
    Maker,
    alike,
    maybe,
    number,
    one,
    one_of,
    several,
    whole,
)

SHIFTED = np.array([[0, 0, 0], [0, 0, -1], [0, 1, 5.0]])  # rows meet rows, five below
COUNTS = [0, 1, 2, 3, 4, 5, 7, 8, 9, 20, 60]


def pair_of(draw: Draw) -> tuple[np.ndarray, np.ndarray]:
    """Return points of two images: of a plane, in space, on a line, alike, or at random."""
    rng, count = draw.rng, int(draw.pick(COUNTS))
    first = rng.uniform(0, 500, (count, 2))
    kind = draw.pick(["plane", "space", "line", "alike", "random", "same"])
    second = rng.uniform(0, 500, (count, 2))
    if kind == "plane":
        second = first @ rng.normal(0, 1, (2, 2)) + rng.normal(0, 99, 2)
    elif kind == "space":
        second = first + [30, 2] / rng.uniform(0.2, 2, (count, 1))
    elif kind == "line":
        first = first[:, :1] * [1, 2]
    elif kind == "alike":
        first = np.repeat(first[:1], count, 0)
    elif kind == "same":
        second = first
    astray = rng.random(count) < draw.pick([0, 0.3])
    second = np.where(astray[:, None], rng.uniform(0, 500, (count, 2)), second)
    scale = draw.pick([1, 1, 1, 1, 1, 1e-6, 1e9, 1e30, 1e200])
    first, second = first * scale, second * scale
    if draw.odd(0.03) and count:
        second[0, 0] = draw.pick([np.nan, np.inf])
    return first, second


def first_of(draw: Draw) -> Any:
    """Return points of the first image, of a pair that :func:`second_of` gives the other of."""
    return pair_of(alike(draw))[0].astype(draw.pick(["f8", "f8", "f4"]))


def second_of(draw: Draw) -> Any:
    """Return points of the second image."""
    return pair_of(alike(draw))[1]


def weights(draw: Draw) -> Any:
    """Return a weight for each pair, mostly."""
    count = len(first_of(draw)) + int(draw.odd(0.1))
    return draw.rng.uniform(0, 2, count) * (draw.rng.random(count) < draw.pick([1, 1, 0.5]))


def fundamental(draw: Draw) -> Any:
    """Return a matrix of rank two, or any."""
    found = draw.rng.normal(size=(3, 3)) * draw.pick([1, 1e-200, 1e200])
    if draw.odd(0.7):
        u, s, v = np.linalg.svd(found)
        found = u @ np.diag([s[0], s[1], 0]) @ v
    return np.zeros((3, 3)) if draw.odd(0.05) else found


def inside(draw: Draw) -> Any:
    """Return a camera's matrix, or any."""
    focal = draw.rng.uniform(100, 900)
    found = np.array([[focal, 0, 250], [0, focal, 250], [0, 0, 1.0]])
    return found if draw.odd(0.9) else draw.rng.normal(size=(3, 3))


def views(draw: Draw) -> Any:
    """Return projections of two or more cameras."""
    return draw.rng.normal(size=(int(draw.pick([2, 2, 3, 1])), 3, 4)) * draw.pick([1, 1e-9, 1e9])


def seen(draw: Draw) -> Any:
    """Return points in two images."""
    return draw.rng.uniform(-9, 9, (int(draw.pick([2, 2, 3])), int(draw.pick(COUNTS)), 2))


def same_camera(draw: Draw) -> Any:
    """Return one camera's matrix for pairs of points, or several."""
    found = np.array([[500, 0, 250], [0, 500, 250], [0, 0, 1.0]])
    return found if draw.odd(0.7) else np.stack([found] * int(draw.pick([1, 2, 3])))


SHAPES = one((500, 500), ((500, 500), (300, 400)), (1, 1), (3,))
CAMERAS: dict[str, Maker] = {"K0": same_camera, "K1": same_camera}
POINTS: dict[str, Maker] = {"points0": first_of, "points1": second_of}
ROBUST: dict[str, Maker] = {
    "threshold": number(0.1, 9),
    "confidence": number(0.5, 0.9999),
    "max_trials": whole(1, 64),
    "seed": whole(0, 9),
}
WEIGHTS: dict[str, Maker] = {"weights": maybe(weights)}
FITS = ("affine", "fundamental", "homography", "similarity")
CALLS: dict[str, Call] = {
    **{f"find_{n}": Call(getattr(cvkern, f"find_{n}"), POINTS, ROBUST) for n in FITS},
    **{f"fit_{n}": Call(getattr(cvkern, f"fit_{n}"), POINTS, WEIGHTS) for n in FITS},
    "find_homographies": Call(cvkern.find_homographies, {"pairs": several(pair_of, 0, 3)}, ROBUST),
    "find_fundamentals": Call(cvkern.find_fundamentals, {"pairs": several(pair_of, 0, 3)}, ROBUST),
    "find_essential": Call(cvkern.find_essential, {**POINTS, **CAMERAS}, ROBUST),
    "find_essentials": Call(
        cvkern.find_essentials, {"pairs": several(pair_of, 0, 3), **CAMERAS}, ROBUST
    ),
    "find_planes": Call(
        cvkern.find_planes,
        POINTS,
        {**ROBUST, "min_inliers": whole(3, 20), "smoothness": number(0, 1)},
    ),
    "rectify_uncalibrated": Call(
        cvkern.rectify_uncalibrated,
        {**POINTS, "F": one_of(fundamental, one(SHIFTED)), "shape": SHAPES},
        {},
    ),
    "sampson_distance": Call(cvkern.sampson_distance, {"matrix": fundamental, **POINTS}, {}),
    "epipolar_lines": Call(
        cvkern.epipolar_lines, {"matrix": fundamental, "points": first_of}, {"image": one(0, 1, 2)}
    ),
    "epipoles": Call(cvkern.epipoles, {"matrix": fundamental}, {}),
    "essential_from_fundamental": Call(
        cvkern.essential_from_fundamental,
        {"matrix": fundamental, "K0": inside, "K1": inside},
        {},
    ),
    "recover_pose": Call(
        cvkern.recover_pose, {"E": fundamental, **POINTS, "K0": inside, "K1": inside}, {}
    ),
    "triangulate": Call(cvkern.triangulate, {"matrices": views, "points": seen}, {}),
}
