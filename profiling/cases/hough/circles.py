"""Circles and ellipses: votes, and the coins of a photograph."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from profiling.arrays import fields, photograph_uint8
from profiling.case import Case, Peer, Shape, Work, unequal

RADII = np.arange(15, 41)
SMALLEST, LARGEST = 15, 40  # radii of the coins, in pixels of the photograph
SPECKS = 30  # pixels that are not on the ellipse
BIN = 2.0  # pixels: width of the bins of the minor semi-axis
GAUSSIAN: dict[str, Any] = {"operator": "gaussian", "mode": "reflect", "low_threshold": 25.5,
                            "high_threshold": 51}  # fmt: skip
NEAR = 3.5  # pixels of the photograph: how close two circles must be to be the same one
NOWHERE = 1e9

Arrays = tuple[np.ndarray, ...]


def _edges(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    return cvkern.canny(photograph_uint8(shape, rng), 1.5, **GAUSSIAN)


def _directed(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    photo = photograph_uint8(shape, rng)
    return cvkern.canny(photo, 1.5, **GAUSSIAN), cvkern.gradient(photo, sigma=1.5).orientation


def _votes(mask: np.ndarray) -> float:
    """Cast: each pixel once for each offset of each circle."""
    draw = importlib.import_module("skimage.draw")
    offsets = sum(len(draw.circle_perimeter(0, 0, int(r))[0]) for r in RADII)
    return float(mask.sum()) * offsets


def _along(mask: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """Vote for the pixels a radius away: in float64, except for the code of the direction."""
    height, width = mask.shape
    votes = np.zeros((len(RADII), height, width), np.int32)
    y, x = np.nonzero(mask)
    turned = orientation[y, x] * np.float32(16384 / (2 * math.pi)) + np.float32(0.5)
    angle = np.floor(turned) * (2 * math.pi / 16384)
    for i, radius in enumerate(RADII):
        down, along = (
            np.floor(radius * np.round(65536 * f(angle)) / 65536 + 0.5).astype(int)
            for f in (np.sin, np.cos)
        )
        for side in (1, -1):
            v, u = y + side * down, x + side * along
            inside = (v >= 0) & (u >= 0) & (v < height) & (u < width)
            np.add.at(votes[i], (v[inside], u[inside]), 1)
    return votes


def _scale(shape: Shape) -> float:
    """How much larger the coins are made; a small picture is a part of theirs."""
    return max(1.0, min(shape[0] / 303, shape[1] / 384))


def _coins(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    coins = importlib.import_module("skimage.data").coins()
    zoom: Any = scipy.ndimage.zoom
    large = zoom(coins, _scale(shape), order=1, grid_mode=True, mode="nearest")
    large = large[: shape[0], : shape[1]]
    rest = [(0, n - m) for n, m in zip(shape, large.shape, strict=True)]
    return np.pad(large, rest, mode="edge")


def _regions(image: np.ndarray) -> Arrays:
    """Row, column and radius of the coins, as scikit-image parts them from the ground."""
    data, filters, measure, segmentation = (
        importlib.import_module(f"skimage.{m}")
        for m in ("data", "filters", "measure", "segmentation")
    )
    coins, scale = data.coins(), _scale(image.shape)
    markers = np.where(coins < 30, 1, np.where(coins > 150, 2, 0))
    parts = segmentation.watershed(filters.sobel(coins), markers) == 2
    labels = measure.label(scipy.ndimage.binary_fill_holes(parts))
    regions = [r for r in measure.regionprops(labels) if r.area > 500]
    found = np.array([(*r.centroid, math.sqrt(r.area / math.pi)) for r in regions])
    whole = (scale * (found[:, :2] + found[:, 2:]) < image.shape).all(axis=1)
    return (found[whole],)


def _in_pixels_of_the_photograph(circles: np.ndarray, image: np.ndarray) -> Arrays:
    half = np.array([0.5, 0.5, 0])  # pixel centres are integers
    return ((circles + half) / _scale(image.shape) - half,)


def _found(image: np.ndarray) -> Arrays:
    scale = _scale(image.shape)
    circles = cvkern.detect_circles(image, (SMALLEST * scale, LARGEST * scale), polarity="bright")
    found = fields((circles.centers, circles.radii))
    return _in_pixels_of_the_photograph(np.column_stack(found), image)


def _opencv(mode: str, dp: float, high: float, threshold: float) -> Any:
    def call(cv2: Any, image: np.ndarray) -> Arrays:
        scale = _scale(image.shape)
        found = cv2.HoughCircles(
            cv2.medianBlur(image, 5), getattr(cv2, mode), dp, 1.5 * SMALLEST * scale, param1=high,
            param2=threshold, minRadius=round(SMALLEST * scale), maxRadius=round(LARGEST * scale),
        )  # fmt: skip
        circles = np.empty((0, 3)) if found is None else found[0, :, [1, 0, 2]].T
        return _in_pixels_of_the_photograph(circles, image)

    return call


def _missed(ours: Arrays, right: Arrays) -> float:
    """Share of the circles, found or there, without one of the other near."""
    (a,), (b,) = ours, right
    if not len(a):
        return 1.0
    gaps = np.abs(a[:, None] - b[None]).max(axis=2)
    return float(1 - ((gaps.min(axis=1) <= NEAR).sum() + (gaps.min(axis=0) <= NEAR).sum())
                 / sum(gaps.shape))  # fmt: skip


def _ellipse(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Pixels along an ellipse, and specks: some 330, because the time is their cube."""
    row, column, major, minor, turn = _drawn(shape)
    t = np.linspace(0, 2 * math.pi, 300)
    u, v = major * np.cos(t), minor * np.sin(t)
    y, x = (row + u * np.sin(turn) + v * np.cos(turn), column + u * np.cos(turn) - v * np.sin(turn))
    mask = rng.random(shape) < SPECKS / (shape[0] * shape[1])
    mask[np.rint(y).astype(int), np.rint(x).astype(int)] = True
    return mask


def _drawn(shape: Shape) -> np.ndarray:
    """Return row, column, semi-axes and orientation of the ellipse in an image of this shape."""
    height, width = shape
    return np.array([0.47 * height, 0.48 * width, 0.42 * height, 0.2 * height, 0.5])


def _sizes(mask: np.ndarray) -> tuple[int, int]:
    """Return the fewest votes, and the shortest major axis, that are looked for.

    scikit-image drops third points that are closer to the centre than the shortest major axis, so
    that is shorter than the minor semi-axis.
    """
    return 20, mask.shape[0] // 8


def _best(mask: np.ndarray) -> Arrays:
    votes, shortest = _sizes(mask)
    found = cvkern.hough_ellipse(mask, votes, BIN, shortest)
    return found.centers[:1], found.axes[:1]


def _best_of_skimage(transform: Any, mask: np.ndarray) -> Arrays:
    votes, shortest = _sizes(mask)
    # Its bins are `accuracy` squared wide, in squares of the minor semi-axis b. Bins of b as wide
    # as cvkern's are 2 b times as wide in b^2. With an accuracy of 2 it makes 73 000 bins per pair
    # at 1080p, and finds nothing.
    accuracy = math.sqrt(2 * _drawn(mask.shape)[3] * BIN)
    found = transform.hough_ellipse(mask, threshold=votes, accuracy=accuracy, min_size=shortest)
    if not len(found):
        return np.full((1, 2), NOWHERE), np.full((1, 2), NOWHERE)
    best = np.sort(found, order="accumulator")[-1]
    return np.array([[best["yc"], best["xc"]]]), np.array([[best["a"], best["b"]]])


def _truth(mask: np.ndarray) -> Arrays:
    drawn = _drawn(mask.shape)
    return drawn[None, :2], drawn[None, 2:4]


def _gap(ours: Arrays, right: Arrays) -> float:
    if not len(ours[0]):
        return NOWHERE
    return float(max(np.abs(a - b).max() for a, b in zip(ours, right, strict=True)))


CASES = (
    Case(
        name="hough_circle",
        title="Votes for circles, 26 radii, edges of a photograph",
        image=_edges,
        call=lambda x: cvkern.hough_circle(x, RADII, normalize=False),
        oracle=lambda x: importlib.import_module("skimage.transform").hough_circle(
            x, RADII, normalize=False
        ),
        oracle_name="skimage.transform.hough_circle",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=1 + 4 * len(RADII),
        operations_per_pixel=0,
        peers=(
            Peer(
                "scikit-image",
                "skimage.transform",
                lambda m, x: m.hough_circle(x, RADII, normalize=False),
            ),
        ),
        work=Work("votes", _votes),
        sizes=("1080p",),
        most_inputs=4,
        margin=0,
    ),
    Case(
        name="hough_circle_directed",
        title="Votes for circles along the gradient, 26 radii",
        image=_directed,
        call=lambda x, o: cvkern.hough_circle(x, RADII, normalize=False, orientation=o),
        oracle=_along,
        oracle_name="the same by NumPy",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=1 + 4 + 4 * len(RADII),
        operations_per_pixel=0,
        captures=False,
        work=Work("votes", lambda x, o: 2.0 * x.sum() * len(RADII)),
        sizes=("1080p",),
        most_inputs=4,
        margin=0,
    ),
    Case(
        name="detect_circles",
        title="The coins of a photograph, enlarged",
        image=_coins,
        call=_found,
        oracle=_regions,
        oracle_name="regions by skimage's watershed",
        difference=_missed,
        tolerance=0.0,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=(
            Peer("OpenCV", "cv2", _opencv("HOUGH_GRADIENT_ALT", 1.5, 300, 0.8)),
            Peer("OpenCV, older", "cv2", _opencv("HOUGH_GRADIENT", 1, 100, 30)),
        ),
        captures=False,
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="hough_ellipse",
        title="An ellipse of 300 pixels among 30 specks",
        image=_ellipse,
        call=_best,
        oracle=_truth,
        oracle_name="the ellipse that was drawn",
        difference=_gap,
        tolerance=2.5,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=(
            Peer(
                "scikit-image",
                "skimage.transform",
                _best_of_skimage,
                note="bins of the squared minor axis, as wide as ours at the ellipse",
            ),
        ),
        captures=False,
        work=Work("third points", lambda x: float(x.sum()) ** 3 / 2),
        sizes=("1080p",),
        margin=0,
    ),
)
