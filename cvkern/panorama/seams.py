"""Seams between the images of a panorama, and gains of their exposures, at a coarse size."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.panorama.registration import pixels
from cvkern.panorama.surfaces import Canvas
from cvkern.panorama.warping import draw, shrunk

SEAM_PIXELS = 250_000  # size of the canvas on which seams are found
SHARPNESS = 20.0  # a difference of 1/20 of white halves the cost of a step
MARGIN = 0.5  # an image is a seed where its weight exceeds all others by this
GAIN_SPREAD = 3.0  # standard deviation of the logarithms of gains
NOISE = 0.04  # standard deviation of the mean colours of an overlap, in parts of white
DARK, BRIGHT = 0.02, 0.98  # parts of white: only values between these measure the exposure
GAIN_SAMPLES = 4000  # about as many pixels of an overlap are compared
LEAST_SAMPLES = 20
DENSITY = 2  # step between the rows and columns in which new white pixels are counted
WHITEST = 0.98  # share of the pixels that are not white before the gains and must not be after them
DIMMEST = 0.6  # least common factor of the gains
ENDS = 4096  # largest number of rounds; a canvas needs about one for every 16 pixels of a side


class Sources(NamedTuple):
    """The images of one panorama, reduced in size."""

    images: list[Any]
    """(H, W, C) or (H, W): arrays, or objects that `pixels` reads."""
    factors: np.ndarray
    """Sides of these images over the sides of the large ones, (N, 2)."""
    white: float
    channels: int


class Seams(NamedTuple):
    """The image that each pixel shows, and the gains."""

    labels: Any
    """(H', W') int32, a kernel array: the image index of each coarse pixel, or -1."""
    gains: np.ndarray
    """(N, C) float32."""
    coarse: Canvas


def find_seams(rt: Runtime, canvas: Canvas, sources: Sources, compensate: bool) -> Seams:
    """Assign every pixel of a coarse canvas to an image, and find the gains."""
    factor = max(1.0, math.sqrt(canvas.width * canvas.height / SEAM_PIXELS))
    coarse = canvas.coarser(factor)
    count, channels = len(sources.images), sources.channels
    sides = coarse.rects[:, 2:] - coarse.rects[:, :2]
    width, height = map(int, sides.max(axis=0))
    values = rt.scratch("panorama.values", (count, channels, height, width))
    weights = rt.scratch("panorama.weights", (count, height, width))
    ones = rt.constant(np.ones(channels, np.float32))
    # What the kernels need of all images is sent at once: each transfer waits for the kernels.
    images, cameras = zip(
        *(
            shrunk(pixels(sources.images[n]), sources.factors[n], n, coarse, canvas)
            for n in range(count)
        ),
        strict=True,
    )
    first = coarse.rects[:, :2].min(axis=0)
    corners = coarse.rects[:, :2] - first
    left, top = map(int, first)
    wide, tall = map(int, corners.max(axis=0))
    seen_by = rt.send("panorama.cameras", np.stack(cameras))
    columns = rt.send("panorama.columns", coarse.columns(left, wide + width))
    rows = rt.send("panorama.rows", coarse.rows(top, tall + height))
    for n, (x, y) in enumerate(corners.tolist()):
        draw(
            rt, images[n], seen_by[n : n + 1], ones, columns[x : x + width], rows[y : y + height],
            values[n], weights[n],
        )  # fmt: skip
    rects = rt.send("panorama.rects", coarse.rects.astype(np.int32))
    gains = np.ones((count, channels), np.float32)
    if compensate and count > 1:
        gains = find_gains(rt.to_numpy(values), rt.to_numpy(weights), coarse, sources.white)
    gray = np.array([len(i.shape) == 2 or i.shape[2] == 1 for i in sources.images])
    if gray.any() and not gray.all():
        gains[gray] = np.exp(np.log(gains[gray]).mean(axis=1, keepdims=True))
        rt.write(weights, _behind(np.array(rt.to_numpy(weights)), gray, coarse))
    shape = coarse.height, coarse.width
    costs = rt.scratch("panorama.costs", shape, np.int32)
    most, second = (rt.scratch(f"panorama.{name}", shape) for name in ("most", "second"))
    kernels = rt.panorama.seams
    kernels.compare(
        values, weights, rects, rt.send("panorama.gains", gains), SHARPNESS / sources.white,
        costs, most, second,
    )  # fmt: skip
    distances = rt.scratch("panorama.distances", (count, height, width), np.int32)
    kernels.seed(weights, rects, most, second, MARGIN, distances)
    changed = rt.scratch("panorama.changed", (1,), np.int32)
    for _ in range(ENDS):
        rt.clear(changed)
        kernels.grow(costs, rects, distances, changed)
        if not rt.to_numpy(changed)[0]:
            break
    labels = rt.scratch("panorama.labels", shape, np.int32)
    kernels.choose(distances, weights, rects, labels)
    return Seams(labels, gains, coarse)


def _behind(weights: np.ndarray, gray: np.ndarray, coarse: Canvas) -> np.ndarray:
    """Return weights that are 0 where a grey image lies on one with colours: it stays behind."""
    seen = np.zeros((coarse.height, coarse.width), bool)
    for last in (False, True):
        for n in np.flatnonzero(gray == last):
            left, top, right, bottom = coarse.rects[n]
            columns, rows = np.arange(left, right) % coarse.width, np.arange(top, bottom)
            part = weights[n, : len(rows), : len(columns)]
            if last:
                part[seen[np.ix_(rows, columns)]] = 0
            else:
                seen[np.ix_(rows, columns)] |= part > 0
    return weights


def find_gains(values: np.ndarray, weights: np.ndarray, coarse: Canvas, white: float) -> np.ndarray:
    """Return the gains (N, C) that equalise the overlaps, after Brown and Lowe, section 6.

    The logarithms of the gains minimise the squared differences of the logarithms of mean colours
    in the overlaps. The weight of an overlap grows with its size and brightness. A small penalty on
    the squares of the logarithms makes their mean 0. If the gains would make new pixels white, one
    common factor lowers them all.
    """
    count, channels = values.shape[:2]
    normal = np.tile(np.eye(count) / GAIN_SPREAD**2, (channels, 1, 1))
    right = np.zeros((channels, count))
    for i, j, shift in _overlapping(coarse):
        found = _overlap(values, weights, coarse, white, i, j, shift)
        if found is None:
            continue
        a, b, number = found
        weight = number / GAIN_SAMPLES * (np.sqrt(a * b) / NOISE) ** 2
        wanted = weight * np.log(b / a)
        normal[:, i, i] += weight
        normal[:, j, j] += weight
        normal[:, i, j] -= weight
        normal[:, j, i] -= weight
        right[:, i] += wanted
        right[:, j] -= wanted
    gains = np.exp(np.linalg.solve(normal, right[..., None])[..., 0].T)
    return (gains * _dimming(values[..., ::DENSITY, ::DENSITY], weights, gains, white)).astype(
        np.float32
    )


def _dimming(values: np.ndarray, weights: np.ndarray, gains: np.ndarray, white: float) -> float:
    """Return a factor, at most 1, that keeps the gains from making new pixels white."""
    there = (weights[..., ::DENSITY, ::DENSITY] > 0) & (values.max(axis=1) < BRIGHT * white)
    lit = (values * gains[..., None, None]).max(axis=1)[there] / white
    if not lit.size:
        return 1.0
    return float(np.clip(1 / max(np.quantile(lit, WHITEST), 1e-6), DIMMEST, 1.0))


def _overlapping(coarse: Canvas) -> list[tuple[int, int, int]]:
    """Return pairs i < j whose rectangles overlap if columns of j are moved by a shift; sorted."""
    rects, found = coarse.rects, []
    for turn in (-1, 0, 1) if coarse.closed else (0,):
        moved = rects + np.array([1, 0, 1, 0]) * (turn * coarse.width)
        low = np.maximum(rects[:, None, :2], moved[None, :, :2])
        high = np.minimum(rects[:, None, 2:], moved[None, :, 2:])
        pairs = np.argwhere(np.triu((high > low).all(axis=2), 1)).tolist()
        found += [(i, j, turn * coarse.width) for i, j in pairs]
    return sorted(found)


def _overlap(
    values: np.ndarray,
    weights: np.ndarray,
    coarse: Canvas,
    white: float,
    i: int,
    j: int,
    shift: int,
) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Return the mean colours of two images in their overlap, in parts of white, and its size.

    None if the overlap has too few pixels that measure an exposure.
    """
    one, other = coarse.rects[i], coarse.rects[j] + (shift, 0, shift, 0)
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    step = max(1, round(math.sqrt((high - low).prod() / GAIN_SAMPLES)))
    cuts = []
    for rect in (one, other):
        x, y = low - rect[:2]
        w, h = high - low
        cuts.append((slice(y, y + h, step), slice(x, x + w, step)))
    there = ((weights[i][cuts[0]] > 0) & (weights[j][cuts[1]] > 0)).ravel()
    # Colours one by one, as NumPy reduces contiguous rows fastest.
    a, b = (
        [colour[cut].ravel() for colour in values[n]] for n, cut in ((i, cuts[0]), (j, cuts[1]))
    )
    fair = there.copy()
    for c, d in zip(a, b, strict=True):
        fair &= np.minimum(c, d) > DARK * white
        fair &= np.maximum(c, d) < BRIGHT * white
    if np.count_nonzero(fair) < LEAST_SAMPLES:
        return None
    number = int(np.count_nonzero(there)) * step * step
    means = np.array([[c[fair].mean(dtype=np.float64) for c in side] for side in (a, b)]) / white
    return means[0], means[1], number
