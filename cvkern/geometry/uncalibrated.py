"""Rectification of uncalibrated cameras: homographies that map epipolar lines to rows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import runtime
from cvkern.geometry._matrices import check_matrix
from cvkern.geometry._points import check_pairs, on_host, xy

TURNS = 720  # candidates for the epipolar line that is mapped to infinity
LEAST_DEPTH = 0.2  # least depth of a corner over that of the centre: below it a picture folds
LEAST_SCALE = 0.3  # least singular value of a map at the centre over the largest one


class RectifyingMaps(NamedTuple):
    """Homographies that put matches on the same row."""

    H0: np.ndarray
    """(3, 3) float64, for the first image; acts on (x, y, 1)."""
    H1: np.ndarray
    """(3, 3) float64, for the second image."""


def rectify_uncalibrated(points0: Any, points1: Any, F: Any, shape: Any) -> RectifyingMaps:
    """Return homographies that put matches of two images on the same row.

    Both map a pair of corresponding epipolar lines to infinity: the pair that stretches the
    pictures least. The remaining freedom keeps the middle of both pictures square and of the same
    size, and puts the median match at the same column.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image, N >= 1: inliers of `F`.
    points1 : array of shape (N, 2)
        Row and column of the matching points in the second image.
    F : array of shape (3, 3)
        Fundamental matrix, x1' F x0 = 0 with (x, y, 1).
    shape : pair of int, or pair of pairs
        Rows and columns of both images, or of each.

    Returns
    -------
    RectifyingMaps
        Named tuple of `H0` and `H1`, for :func:`warp_perspective`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, a number is not finite, or every such homography folds a picture
        or stretches it beyond use, because an epipole is in a picture or close to it.

    References
    ----------
    C. Loop and Z. Zhang, "Computing rectifying homographies for stereo vision", CVPR 1999;
    R. Hartley, "Theory and practice of projective rectification", IJCV 35(2), 1999.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> points = np.random.default_rng(0).uniform(0, 100, (30, 2))
    >>> moved = points + (5, 8)
    >>> shifted = [[0, 0, 0], [0, 0, -1], [0, 1, 5]]  # five rows down
    >>> H0, H1 = cvkern.rectify_uncalibrated(points, moved, shifted, (100, 100))
    >>> (H0 - np.eye(3)).round(6)[:2, 2].tolist(), (H1 - np.eye(3)).round(6)[:2, 2].tolist()
    ([4.0, 2.5], [-4.0, -2.5])
    """
    points0, points1 = check_pairs(points0, points1)
    rt = runtime(points0, points1)
    a, b = (xy(on_host(rt, p)) for p in (points0, points1))
    if not len(a) or not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("points0 and points1 must be finite and at least one, got others")
    sizes = _check_shapes(shape)
    units = [_unit(size) for size in sizes]  # from pixels to a picture about 0
    f = np.linalg.inv(units[1]).T @ check_matrix(F, (3, 3), "F") @ np.linalg.inv(units[0])
    if np.linalg.matrix_rank(f) < 2:
        raise ValueError("F must be of rank 2, got a matrix of a lower rank")
    corners = [_corners(size) @ unit.T for size, unit in zip(sizes, units, strict=True)]
    first, second = _to_infinity(f, corners)
    parallel = np.linalg.inv(second).T @ f @ np.linalg.inv(first)
    first, second = _to_rows(parallel, first, second)
    both = [_squared(h, c) for h, c in zip((first, second), corners, strict=True)]
    maps = [m @ unit for m, unit in zip(both, units, strict=True)]
    return RectifyingMaps(*_placed(maps, (a, b), sizes))


def _check_shapes(shape: Any) -> list[tuple[float, float]]:
    """Return width and height of both images."""
    shapes = np.asarray(shape)
    if shapes.shape not in ((2,), (2, 2)) or shapes.dtype.kind not in "iu" or (shapes < 2).any():
        raise ValueError(
            f"shape must be rows and columns >= 2, of both images or each, got {shape}"
        )
    return [(float(w), float(h)) for h, w in np.broadcast_to(shapes, (2, 2))]


def _unit(size: tuple[float, float]) -> np.ndarray:
    width, height = size
    scale = 2 / np.hypot(width, height)
    return np.array(
        [[scale, 0, -scale * (width - 1) / 2], [0, scale, -scale * (height - 1) / 2], [0, 0, 1]]
    )


def _corners(size: tuple[float, float]) -> np.ndarray:
    """Return (x, y, 1) of the corners, by rows."""
    width, height = size
    return np.array([[0, 0, 1], [width - 1, 0, 1], [0, height - 1, 1], [width - 1, height - 1, 1]])


def _to_infinity(f: np.ndarray, corners: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Send the pair of epipolar lines to infinity that changes the depths of corners least."""
    _, _, vt = np.linalg.svd(f)
    epipole = vt[2]

    def pair(turn: Any) -> tuple[np.ndarray, np.ndarray]:
        line = np.cos(turn)[:, None] * vt[0] + np.sin(turn)[:, None] * vt[1]
        return line, np.cross(epipole, line) @ f.T

    def stretch(turn: Any) -> np.ndarray:
        total = np.zeros(len(turn))
        for line, corner in zip(pair(turn), corners, strict=True):
            with np.errstate(divide="ignore", invalid="ignore"):
                depths = line @ corner.T / line[:, 2:]  # the centre is 0
            least = depths.min(axis=1)
            total += np.where(least > LEAST_DEPTH, ((depths - 1) ** 2).sum(axis=1), np.inf)
        return np.where(np.isnan(total), np.inf, total)

    turns = np.pi * np.arange(TURNS) / TURNS
    width, best = np.pi / TURNS, 0.0
    for _ in range(12):
        costs = stretch(turns)
        best = turns[costs.argmin()]
        turns = best + width * np.linspace(-1, 1, 21)
        width /= 10
    if not np.isfinite(stretch(np.array([best]))[0]):
        raise ValueError(
            "F must have its epipoles outside of both pictures and not close to them, or "
            "rectifying folds a picture; got one for which it does"
        )
    return tuple(
        np.array([[1, 0, 0], [0, 1, 0], line[0] / line[0, 2]]) for line in pair(np.array([best]))
    )  # type: ignore[return-value]


def _to_rows(
    parallel: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Turn parallel epipolar lines a x1 + b y1 + c x0 + d y0 + e = 0 into the same rows."""
    a, b, e = parallel[:, 2]
    c, d = parallel[2, :2]
    # The row of a point is along (c, d) or (a, b): upright in the first picture.
    sign = 1.0 if d >= 0 else -1.0
    one, other = np.hypot(c, d), np.hypot(a, b)
    down, across = sign * np.array([c, d]) / one, -sign * np.array([a, b]) / other
    # With rows r0, r1 along these, one r0 - other r1 + sign e = 0.
    share = np.sqrt(one / other)
    moved = sign * e / other / share / 2
    turned = []
    for h, n, scale, shift in ((first, down, share, moved), (second, across, 1 / share, -moved)):
        turn = np.array([[n[1], -n[0], 0], [scale * n[0], scale * n[1], shift], [0, 0, 1]])
        turned.append(turn @ h)
    return turned[0], turned[1]


def _squared(h: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Shear and stretch along rows so that the middle lines of a picture stay square, as long."""
    top_left, top_right, bottom_left, bottom_right = corners
    middles = np.stack(
        (top_left + bottom_left, top_right + bottom_right, top_left + top_right,
         bottom_left + bottom_right)
    ) / 2  # fmt: skip
    q = middles @ h.T
    q = q[:, :2] / q[:, 2:]
    along, down = q[1] - q[0], q[3] - q[2]
    width, height = middles[1, 0] - middles[0, 0], middles[3, 1] - middles[2, 1]
    # With x' = p x + q y the lines are square, and their lengths as those of the picture.
    det = along[0] * down[1] - along[1] * down[0]
    p = (height**2 * along[1] ** 2 + width**2 * down[1] ** 2) / (height * width * abs(det))
    r = (height**2 * along[0] * along[1] + width**2 * down[0] * down[1]) / (
        height * width * abs(det)
    )
    return np.array([[p, -r, 0], [0, 1, 0], [0, 0, 1]]) @ h


def _placed(
    maps: list[np.ndarray], points: tuple[np.ndarray, np.ndarray], sizes: list[tuple[float, float]]
) -> list[np.ndarray]:
    """Scale and move both pictures to their size and about their place; refuse slivers."""
    areas, middles = [], []
    for h, size in zip(maps, sizes, strict=True):
        width, height = size
        q = _corners(size) @ h.T
        x, y = (q[[0, 1, 3, 2], :2] / q[[0, 1, 3, 2], 2:]).T
        area = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
        areas.append(area / ((width - 1) * (height - 1)))
        middles.append(h @ ((width - 1) / 2, (height - 1) / 2, 1))
    if not (min(areas) > 0 and min(areas) > LEAST_SCALE**2 * max(areas)):
        raise ValueError(
            "F must let both pictures keep their sizes, or rectifying makes a sliver of one; got "
            f"areas of which one is {min(areas) / max(areas):.2g} of the other"
        )
    scale = (areas[0] * areas[1]) ** -0.25
    seen = [np.c_[p, np.ones(len(p))] @ h.T for h, p in zip(maps, points, strict=True)]
    columns = [scale * q[:, 0] / q[:, 2] for q in seen]
    gap = np.median(columns[0] - columns[1])
    centre = np.mean([scale * m[:2] / m[2] for m in middles], axis=0)
    target = np.mean([(np.array(size) - 1) / 2 for size in sizes], axis=0)
    shift = target - centre
    moved = []
    for h, side in zip(maps, (-gap / 2, gap / 2), strict=True):
        move = np.array([[scale, 0, shift[0] + side], [0, scale, shift[1]], [0, 0, 1]])
        m = move @ h
        moved.append(m / m[2, 2])
    return moved
