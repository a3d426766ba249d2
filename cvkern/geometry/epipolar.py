"""Fundamental matrices: fits, robust fits, epipolar lines and distances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import check_integer
from cvkern._runtime import runtime
from cvkern.geometry._batches import check_batch, search_options
from cvkern.geometry._matches import gather
from cvkern.geometry._matrices import check_matrix
from cvkern.geometry._points import check_pairs, check_points, finite_pairs, on_host, xy
from cvkern.geometry.fitting import SINGULAR, normalise
from cvkern.geometry.robust import Explorer, Found, RobustFit, RobustFits, Search, alone
from cvkern.kernels.codes.geometry import Model

# Trials for a plane, and for epipoles from matches off it. Both have many matches if they matter.
PLANE_TRIALS, EPIPOLE_TRIALS = 2048, 1024
LEAST = 2.0**-60  # share of the largest entry of a matrix; smaller entries are rounding errors


def fit_fundamental(points0: Any, points1: Any, weights: Any = None) -> np.ndarray:
    """Fit a fundamental matrix to matched points: exactly to seven, by least squares to more.

    This is the normalised eight-point algorithm. It minimises the weighted sum of squares of the
    equations x1' F x0 = 0 in centred coordinates, and then sets the least singular value to 0.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image; N >= 7.
    points1 : array of shape (N, 2)
        Row and column of the same points in the second image.
    weights : array of shape (N,), optional
        Weights, not negative; equal by default. Points of weight 0 are ignored.

    Returns
    -------
    numpy.ndarray of shape (3, 3), float64
        Acts on (x, y, 1), with x the column and y the row: x1' F x0 = 0. Its sum of squares is 1.
        Seven points determine one or three such matrices: the array then has shape (K, 3, 3).

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match or a number is not finite, a weight is negative, or the points do
        not determine a fundamental matrix: fewer than seven, or all on one plane.

    References
    ----------
    R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition, 2004,
    algorithm 11.1 and section 11.1.2.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points0 = rng.uniform(0, 100, (9, 2))
    >>> points1 = points0 + np.stack((np.zeros(9), rng.uniform(3, 9, 9)), 1)  # rectified
    >>> abs(cvkern.fit_fundamental(points0, points1) * 2**0.5).round(6).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    """
    a, b, w = finite_pairs(points0, points1, weights)
    if len(a) < 7:
        raise ValueError(f"points0 must be at least 7 for a fundamental matrix, got {len(a)}")
    (a, to_a), (b, to_b) = normalise(a, w), normalise(b, w)
    one = np.ones((len(a), 1))
    rows = (np.c_[b, one][:, :, None] * np.c_[a, one][:, None, :]).reshape(-1, 9)
    _, s, vt = np.linalg.svd(rows * np.sqrt(w)[:, None], full_matrices=len(rows) < 9)
    rank = min(len(rows), 8)
    if s[rank - 1] <= SINGULAR * s[0]:
        raise ValueError(
            "points0 and points1 must fix a fundamental matrix, got points that lie on one plane, "
            "or too many of which are the same"
        )
    if len(rows) == 7:
        found = [x * vt[7] + y * vt[8] for x, y in _singular_pencil(vt[7], vt[8])]
        return np.stack([rank_two(to_b.T @ f.reshape(3, 3) @ to_a) for f in found])
    return rank_two(to_b.T @ rank_two(vt[8].reshape(3, 3)) @ to_a)


def _singular_pencil(a: np.ndarray, b: np.ndarray) -> list[tuple[float, float]]:
    """Return the real (x, y), up to scale, with det(x A + y B) = 0: a cubic through four points."""
    turns = np.pi * np.arange(4) / 4
    values = [np.linalg.det((np.cos(t) * a + np.sin(t) * b).reshape(3, 3)) for t in turns]
    powers = [[np.cos(t) ** (3 - k) * np.sin(t) ** k for k in range(4)] for t in turns]
    cubic = np.linalg.solve(powers, values)  # coefficients of x^3, x^2 y, x y^2, y^3
    found = []
    for root in np.roots(cubic):
        if abs(root.imag) <= 1e-9 * (1 + abs(root)):
            found.append((root.real, 1.0))
    if abs(cubic[0]) <= 1e-14 * np.abs(cubic).max():  # NumPy leaves out what is at infinity
        found.append((1.0, 0.0))
    return found


def rank_two(matrices: np.ndarray) -> np.ndarray:
    """Return the nearest matrices of rank 2, scaled to a sum of squares of 1; keep NaN."""
    found = np.full(matrices.shape, np.nan)
    known = np.isfinite(matrices).all(axis=(-2, -1))
    u, s, vt = np.linalg.svd(matrices[known])
    length = np.hypot(s[..., 0], s[..., 1])[..., None, None]
    found[known] = (u[..., :2] * s[..., None, :2]) @ vt[..., :2, :] / length
    return found


def find_fundamental(
    points0: Any,
    points1: Any,
    threshold: float = 1.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFit:
    """Find the fundamental matrix that many of the given matches support.

    As :func:`find_homography`, from samples of seven matches and by Sampson's distance. Where most
    matches lie on one plane, samples from it fix no epipole: so the homography of the largest
    plane is found as well, and epipoles from two matches off it compete with the samples.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image. Matches that are not finite are outliers.
    points1 : array of shape (N, 2)
        Row and column of the matching points in the second image.
    threshold : float, default 1.0
        Largest Sampson distance of an inlier, pixels.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    RobustFit
        Named tuple of `matrix`, `inliers` and `cost`. The matrix obeys x1' F x0 = 0 and has a sum
        of squares of 1. It is None if there are fewer than eight inliers, or if chance alone
        explains as many.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches, arrays are on several
        devices, or an option is out of range.

    References
    ----------
    O. Chum, T. Werner and J. Matas, "Two-view geometry estimation unaffected by a dominant plane",
    CVPR 2005; P. Sampson, Computer Graphics and Image Processing 18, 1982 (the distance).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points0 = rng.uniform(0, 500, (100, 2))
    >>> points1 = points0 + np.stack((np.zeros(100), rng.uniform(3, 90, 100)), 1)  # rectified
    >>> points1[:30] = rng.uniform(0, 500, (30, 2))
    >>> bool(cvkern.find_fundamental(points0, points1).inliers[30:].all())
    True
    """
    options = search_options(threshold, confidence, max_trials, seed)
    return alone(_find([(points0, points1)], options))


def find_fundamentals(
    pairs: Sequence[tuple[Any, Any]],
    threshold: float = 1.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFits:
    """Find the fundamental matrix of each of several pairs of images, all at once.

    Each is what :func:`find_fundamental` finds for the pair alone. A pair without a
    result, because of too few matches or numbers that are not finite, does not affect the others.

    Parameters
    ----------
    pairs : sequence of pairs of arrays of shape (N, 2)
        Row and column in the first and in the second image. N may differ between pairs.
    threshold : float, default 1.0
        Largest Sampson distance of an inlier, pixels.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    RobustFits
        Named tuple of `matrices` (NaN for a pair without one), `inliers`, `offsets` and `costs`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If there is no pair, a shape does not match, there are more than 262144 matches of a pair,
        arrays are on several devices, or an option is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform(0, 500, (50, 2))
    >>> moved = points + np.stack((np.zeros(50), rng.uniform(3, 90, 50)), 1)
    >>> fits = cvkern.find_fundamentals([(points, moved), (points[:5], moved[:5])])
    >>> bool(fits.inliers[:50].all()), bool(np.isnan(fits.matrices[1]).all())
    (True, True)
    """
    return _find(pairs, search_options(threshold, confidence, max_trials, seed))


def _find(pairs: Sequence[tuple[Any, Any]], options: Search) -> RobustFits:
    batched = check_batch(pairs)
    batch = gather(batched.rt, batched.points, alike=True)
    explorer = Explorer(batched.rt, batch, options)
    found = _beside_planes(explorer, explorer.explore(Model.FUNDAMENTAL))
    matrices, marks, costs = explorer.finish(Model.FUNDAMENTAL, found)
    # In units of the points' spread, entries so small are what rounding has left, down to denormal
    # numbers; the points' distance from the origin would make digits of them.
    largest = np.abs(matrices).max(axis=(1, 2), keepdims=True)
    matrices = np.where(np.abs(matrices) < LEAST * largest, 0.0, matrices)
    matrices = batch.to_unit[1].swapaxes(1, 2) @ matrices @ batch.to_unit[0]
    return batched.fits(batch, rank_two(matrices), marks, costs)


def _beside_planes(explorer: Explorer, found: Found) -> Found:
    """Compare models from the homography of a plane and two more matches with the best so far."""
    planes = explorer.explore(Model.HOMOGRAPHY, most=PLANE_TRIALS)
    given = planes.models.copy()
    real = explorer.significant(Model.HOMOGRAPHY, planes.supports, planes.trials)
    given[~real] = np.nan
    other = explorer.explore(Model.PARALLAX, given, most=EPIPOLE_TRIALS)
    better = other.costs < found.costs
    return Found(
        np.where(better[:, None], other.models, found.models),
        np.where(better, other.costs, found.costs),
        np.where(better, other.supports, found.supports),
        found.trials + other.trials,
    )


def epipolar_lines(matrix: Any, points: Any, image: int = 0) -> np.ndarray:
    """Return the epipolar lines in one image of points in the other.

    Parameters
    ----------
    matrix : array of shape (3, 3)
        Fundamental matrix, x1' F x0 = 0 with (x, y, 1).
    points : array of shape (N, 2)
        Row and column.
    image : int, default 0
        The image of the points: 0 the first, 1 the second. The lines are in the other one.

    Returns
    -------
    numpy.ndarray of shape (N, 3), float64
        (a, b, c): a x + b y + c = 0 for the column x and the row y, with a^2 + b^2 = 1. NaN for
        the line of an epipole, and for points that are not finite.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, the matrix is not finite, or `image` is neither 0 nor 1.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rectified = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]
    >>> (cvkern.epipolar_lines(rectified, [[7, 40]]) + 0).tolist()  # the row y = 7
    [[0.0, -1.0, 7.0]]
    """
    f = check_matrix(matrix, (3, 3), "matrix")
    points = check_points(points, "points")
    p = xy(on_host(runtime(points), points))
    f = f.T if check_integer(image, "image", 0, 1) else f
    with np.errstate(all="ignore"):  # points may be at infinity
        lines = np.c_[p, np.ones(len(p))] @ f.T
        lines /= np.hypot(lines[:, 0], lines[:, 1])[:, None]
    lines[~np.isfinite(lines).all(axis=1)] = np.nan
    return lines


def epipoles(matrix: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the epipoles: the image of each camera's centre in the other image.

    Parameters
    ----------
    matrix : array of shape (3, 3)
        Fundamental matrix, x1' F x0 = 0 with (x, y, 1).

    Returns
    -------
    tuple of two numpy.ndarray of shape (3,), float64
        (x, y, w) of the epipoles in the first and in the second image: the column is x / w, the
        row y / w, at infinity where w is 0. The sum of squares is 1, and w is not negative.

    Raises
    ------
    TypeError
        If the matrix does not hold real numbers.
    ValueError
        If its shape does not match or it is not finite.

    Examples
    --------
    >>> import cvkern
    >>> first, second = cvkern.epipoles([[0, 0, 0], [0, 0, -1], [0, 1, 0]])
    >>> abs(first).tolist()  # along the rows
    [1.0, 0.0, 0.0]
    """
    u, _, vt = np.linalg.svd(check_matrix(matrix, (3, 3), "matrix"))
    first, second = (e if e[2] >= 0 else -e for e in (vt[2], u[:, 2]))
    return first, second


def sampson_distance(matrix: Any, points0: Any, points1: Any) -> np.ndarray:
    """Return the distances of matches from an epipolar geometry, to first order.

    Parameters
    ----------
    matrix : array of shape (3, 3)
        Fundamental matrix, x1' F x0 = 0 with (x, y, 1).
    points0 : array of shape (N, 2)
        Row and column in the first image.
    points1 : array of shape (N, 2)
        Row and column in the second image.

    Returns
    -------
    numpy.ndarray of shape (N,), float64
        Pixels: the least joint displacement of both points that satisfies the equation, in the
        linear approximation at the points. NaN where either point is not finite.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, or the matrix is not finite.

    Examples
    --------
    >>> import cvkern
    >>> rectified = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]
    >>> cvkern.sampson_distance(rectified, [[3, 5]], [[5, 9]]).round(6).tolist()  # 2 / sqrt(2)
    [1.414214]
    """
    f = check_matrix(matrix, (3, 3), "matrix")
    points0, points1 = check_pairs(points0, points1)
    rt = runtime(points0, points1)
    a, b = (np.c_[xy(on_host(rt, p)), np.ones(len(p))] for p in (points0, points1))
    with np.errstate(all="ignore"):  # points may be at infinity
        right, left = a @ f.T, b @ f
        under = (right[:, :2] ** 2).sum(axis=1) + (left[:, :2] ** 2).sum(axis=1)
        return np.abs((b * right).sum(axis=1)) / np.sqrt(under)
