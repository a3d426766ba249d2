"""Homographies, affine maps and similarities by least squares, in float64 on the host."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern.geometry._points import finite_pairs

# Singular values below this share of the largest count as 0: with coordinates scaled to about 1
# float64 leaves 1e-13, and points that are apart by 1e-4 of the picture leave more than 1e-8.
SINGULAR = 1e-9


def fit_homography(points0: Any, points1: Any, weights: Any = None) -> np.ndarray:
    """Fit a homography to matched points: exactly to four, by least squares to more.

    This is the normalised direct linear transform. Both lists are shifted and scaled to a centre
    of 0 and a mean distance of sqrt(2) from it. The result minimises the weighted sum of squares of
    the linear equations x1 x (H x0) = 0.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image; N >= 4.
    points1 : array of shape (N, 2)
        Row and column of the same points in the second image.
    weights : array of shape (N,), optional
        Weights, not negative; equal by default. Points of weight 0 are ignored.

    Returns
    -------
    numpy.ndarray of shape (3, 3), float64
        Acts on (x, y, 1), with x the column and y the row, and maps the first image to the
        second. It is scaled to a last element of 1, or if that is 0, to a sum of squares of 1.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match or a number is not finite, a weight is negative, or the points
        determine no homography: fewer than four, or three of four on a line in either image.

    References
    ----------
    R. Hartley, "In defense of the eight-point algorithm", IEEE TPAMI 19(6), 1997; R. Hartley and
    A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition, algorithm 4.2, 2004.

    Examples
    --------
    >>> import cvkern
    >>> square = [[0, 0], [0, 2], [2, 2], [2, 0]]
    >>> cvkern.fit_homography(square, [[1, 5], [1, 7], [3, 7], [3, 5]]).round(6) + 0
    array([[1., 0., 5.],
           [0., 1., 1.],
           [0., 0., 1.]])
    """
    a, b, w = finite_pairs(points0, points1, weights)
    _check_count(len(a), 4, "a homography")
    (a, to_a), (b, to_b) = normalise(a, w), normalise(b, w)
    x, y = a.T
    u, v = b.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.stack(
        (
            np.stack((x, y, one, zero, zero, zero, -u * x, -u * y, -u), 1),
            np.stack((zero, zero, zero, x, y, one, -v * x, -v * y, -v), 1),
        ),
        1,
    )
    rows = (rows * np.sqrt(w)[:, None, None]).reshape(-1, 9)
    _, s, vt = np.linalg.svd(rows, full_matrices=len(rows) < 9)
    h = vt[8].reshape(3, 3)
    # Two equal least singular values leave a family of maps; a singular map has no inverse.
    if s[7] <= SINGULAR * s[0] or abs(np.linalg.det(h)) <= SINGULAR:
        raise ValueError(
            "points0 and points1 must determine a homography, got points too many of which are "
            "on one line, or one point"
        )
    return scaled(np.linalg.inv(to_b) @ h @ to_a)


def fit_affine(points0: Any, points1: Any, weights: Any = None) -> np.ndarray:
    """Fit an affine map to matched points, in least squares.

    Parameters
    ----------
    points0, points1, weights : array of shape (N, 2), (N, 2) and (N,)
        As in :func:`fit_homography`; N >= 3.

    Returns
    -------
    numpy.ndarray of shape (3, 3), float64
        Acts on (x, y, 1), with x the column and y the row; its last row is (0, 0, 1). The
        weighted sum of squared distances in the second image is the least there is.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match or a number is not finite, a weight is negative, or there are
        fewer than three points, or all of `points0` are on one line.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.fit_affine([[0, 0], [0, 1], [1, 0]], [[4, 3], [4, 5], [5, 3]]).round(6) + 0
    array([[2., 0., 3.],
           [0., 1., 4.],
           [0., 0., 1.]])
    """
    a, b, w = finite_pairs(points0, points1, weights)
    _check_count(len(a), 3, "an affine map")
    (a, to_a), (b, to_b) = normalise(a, w), normalise(b, w)
    root = np.sqrt(w)[:, None]
    rows = np.column_stack((a, np.ones(len(a)))) * root
    solution, _, _, s = np.linalg.lstsq(rows, b * root, rcond=None)
    if s[2] <= SINGULAR * s[0]:
        raise ValueError(
            "points0 must determine an affine map, got points that are all on one line"
        )
    matrix = np.linalg.inv(to_b) @ np.vstack((solution.T, (0, 0, 1))) @ to_a
    matrix[2] = 0, 0, 1
    return matrix


def fit_similarity(points0: Any, points1: Any, weights: Any = None) -> np.ndarray:
    """Fit a similarity (rotation, scale, translation) to matched points, in least squares.

    Parameters
    ----------
    points0, points1, weights : array of shape (N, 2), (N, 2) and (N,)
        As in :func:`fit_homography`; N >= 2.

    Returns
    -------
    numpy.ndarray of shape (3, 3), float64
        Acts on (x, y, 1), with x the column and y the row: ((a, -b, c), (b, a, d), (0, 0, 1)),
        never a mirror image. It minimises the weighted sum of squared distances in the
        second image.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match or a number is not finite, a weight is negative, or there are
        fewer than two points, or all of `points0` are one.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.fit_similarity([[0, 0], [0, 1]], [[2, 3], [3, 3]]).round(6) + 0
    array([[ 0., -1.,  3.],
           [ 1.,  0.,  2.],
           [ 0.,  0.,  1.]])
    """
    a, b, w = finite_pairs(points0, points1, weights)
    _check_count(len(a), 2, "a similarity")
    share = w / w.sum()
    # In complex numbers z1 = m z0 + t, whose least squares are those of a line.
    z0, z1 = (p[:, 0] + 1j * p[:, 1] for p in (a, b))
    mean0, mean1 = share @ z0, share @ z1
    spread = share @ np.abs(z0 - mean0) ** 2
    if spread <= (SINGULAR * np.abs(z0).max()) ** 2:
        raise ValueError("points0 must be two or more, in different places, got one place")
    m = share @ ((z0 - mean0).conj() * (z1 - mean1)) / spread
    t = mean1 - m * mean0
    return np.array([[m.real, -m.imag, t.real], [m.imag, m.real, t.imag], [0.0, 0.0, 1.0]])


def normalise(points: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points with centre 0 and mean distance sqrt(2) from it, and the matrix."""
    share = weights / weights.sum()
    centre = share @ points
    distance = share @ np.hypot(*(points - centre).T)
    scale = np.sqrt(2) / distance if distance > 0 else 1.0
    matrix = np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])
    return (points - centre) * scale, matrix


def scaled(matrices: np.ndarray) -> np.ndarray:
    """Divide matrices (..., 3, 3) by their last element, or by their norm if that element is 0."""
    norm = np.sqrt((matrices**2).sum(axis=(-2, -1), keepdims=True))
    last = matrices[..., 2:, 2:]
    return matrices / np.where(np.abs(last) > 1e-12 * norm, last, norm)


def _check_count(count: int, least: int, name: str) -> None:
    if count < least:
        raise ValueError(f"points0 must be at least {least} for {name}, got {count}")
