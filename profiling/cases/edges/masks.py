"""Edges: OpenCV's Canny bit for bit, Canny on Gaussian derivatives, and sub-pixel edges."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.ndimage
from scipy.spatial import KDTree

import cvkern
from profiling.arrays import noise, noise_uint8, photograph, photograph_uint8
from profiling.case import Case, Peer, Shape, disagreeing, kornia_peers, skimage_peers

LOW, HIGH = 100.0, 200.0  # thresholds of the integer Sobel
SIGMA, SOFT_LOW, SOFT_HIGH = 2.0, 0.16, 0.32  # in Sobel's units, of an image in [0, 1]
SOBEL_GAIN = 8  # Sobel's kernels against a derivative per pixel

# float32 and float64 decide otherwise only where two numbers agree within 1e-6, but one decision
# may let a whole chain of weak pixels in or out. A wrong rule moves far more pixels than this.
FLIPPED = 1e-3
NEAR = 0.01  # pixels: how close two edge points must lie to be the same one

Pair = tuple[np.ndarray, np.ndarray]


def _slopes(image: np.ndarray) -> Pair:
    x = image.astype(np.float64)
    smooth: Any = scipy.ndimage.gaussian_filter
    return tuple(SOBEL_GAIN * smooth(x, SIGMA, order=order) for order in ((1, 0), (0, 1)))


def _thinned(dy: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Magnitudes that are a maximum along their gradient (Canny 1986), 0 elsewhere."""
    magnitude = np.hypot(dx, dy)
    padded = np.pad(magnitude, 1)
    h, w = magnitude.shape

    def shifted(down: int, along: int) -> np.ndarray:
        return padded[1 + down : 1 + down + h, 1 + along : 1 + along + w]

    steep = np.abs(dy) > np.abs(dx)
    big, small = np.maximum(np.abs(dx), np.abs(dy)), np.minimum(np.abs(dx), np.abs(dy))
    opposite = (dx < 0) != (dy < 0)  # the gradient points along the other diagonal

    def interpolated(side: int) -> np.ndarray:
        straight = np.where(steep, shifted(side, 0), shifted(0, side))
        corner = np.where(
            opposite,
            np.where(steep, shifted(side, -side), shifted(-side, side)),
            shifted(side, side),
        )
        return straight * (big - small) + corner * small

    here = magnitude * big
    return np.where((here > interpolated(-1)) & (here >= interpolated(1)), magnitude, 0.0)


def _canny(image: np.ndarray) -> np.ndarray:
    """Canny by SciPy, in float64."""
    ridge = _thinned(*_slopes(image))
    labelled: Any = scipy.ndimage.label(ridge > SOFT_LOW, structure=np.ones((3, 3)))
    labels, count = labelled
    strong = np.zeros(count + 1, bool)
    strong[labels[ridge > SOFT_HIGH]] = True
    strong[0] = False
    return strong[labels]


def _subpixel(image: np.ndarray) -> np.ndarray:
    """Points of the edge pixels: the peak of the Gaussian through three squared magnitudes."""
    dy, dx = _slopes(image)
    rows, columns = np.nonzero(_canny(image))
    steep = np.abs(dy[rows, columns]) > np.abs(dx[rows, columns])
    squares = np.pad(dx * dx + dy * dy, 1)
    before, here, after = (
        squares[rows + 1 + side * steep, columns + 1 + side * ~steep] for side in (-1, 0, 1)
    )
    kept = (here > before) & (here >= after) & (before > 0) & (after > 0)
    a, b, c = (np.log(m[kept]) for m in (before, here, after))
    points = np.stack([rows[kept], columns[kept]], axis=1).astype(np.float64)
    points[np.arange(len(points)), (~steep[kept]).astype(int)] += 0.5 * (a - c) / (a - 2 * b + c)
    return points


def _unmatched(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Share of the points, of either answer, without a point of the other within NEAR."""
    sets = ours[0], theirs[0]
    if min(map(len, sets)) == 0:
        return float(len(sets[0]) != len(sets[1]))
    trees = [KDTree(points) for points in sets]
    gaps = [trees[1 - i].query(sets[i])[0] for i in (0, 1)]
    return float(np.mean(~(np.concatenate(gaps) <= NEAR)))


def _as_opencv(norm: str, image: str, make: Any) -> Case:
    l2 = norm == "l2"
    return Case(
        name=f"canny_{norm}_{image}",
        title=f"Canny as OpenCV's, {norm.upper()}, {image}, uint8",
        image=make,
        call=lambda x: cvkern.canny(
            x, 0.0, LOW, HIGH, suppression="sectors", norm=norm, mode="nearest"
        ),
        oracle=lambda x: importlib.import_module("cv2").Canny(x, LOW, HIGH, L2gradient=l2),
        oracle_name="cv2.Canny",
        difference=disagreeing,
        tolerance=0.0,
        bytes_per_pixel=2,
        operations_per_pixel=24,
        peers=(
            Peer("OpenCV", "cv2", lambda m, x: m.Canny(x, LOW, HIGH, L2gradient=l2)),
            *kornia_peers(lambda m, x: m.canny(x, LOW, HIGH, l2)),
        ),
    )


def _colours(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """A photograph whose channels show different parts of it."""
    return np.dstack([photograph_uint8(shape, rng) for _ in range(3)])


def _gaussian(image: str, make: Any) -> Case:
    return Case(
        name=f"canny_gaussian_{image}",
        title=f"Canny, sigma 2, {image}, float32",
        image=make,
        call=lambda x: cvkern.canny(
            x, SIGMA, SOFT_LOW, SOFT_HIGH, operator="gaussian", mode="reflect"
        ),
        oracle=_canny,
        oracle_name="Canny by SciPy in float64",
        difference=disagreeing,
        tolerance=FLIPPED,
        bytes_per_pixel=5,
        operations_per_pixel=4 * 2 * 17 + 24,
        peers=skimage_peers(
            "feature",
            lambda m, x: m.canny(x, SIGMA, SOFT_LOW, SOFT_HIGH, mode="reflect"),
            "Sobel of the smoothed image",
        ),
    )


CASES = (
    _as_opencv("l1", "photograph", photograph_uint8),
    _as_opencv("l1", "noise", noise_uint8),
    _as_opencv("l2", "photograph", photograph_uint8),
    _as_opencv("l2", "noise", noise_uint8),
    replace(
        _as_opencv("l2", "colours", _colours),
        bytes_per_pixel=4,
        operations_per_pixel=3 * 16 + 24,
        peers=(Peer("OpenCV", "cv2", lambda m, x: m.Canny(x, LOW, HIGH, L2gradient=True)),),
    ),
    _gaussian("photograph", photograph),
    _gaussian("noise", noise),
    Case(
        name="subpixel_edges",
        title="Edges within the pixel, sigma 2, photograph, float32",
        image=photograph,
        call=lambda x: cvkern.subpixel_edges(x, SIGMA, SOFT_LOW, SOFT_HIGH)[:1],
        oracle=_subpixel,
        oracle_name="the same points by SciPy in float64",
        difference=_unmatched,
        tolerance=FLIPPED,
        bytes_per_pixel=4,
        operations_per_pixel=4 * 2 * 17 + 24,
        captures=False,
    ),
)
