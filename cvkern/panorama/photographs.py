"""Matches of two photographs that a homography explains: found, then found again beside it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from cvkern._ahead import compiles_ahead
from cvkern._checks import check_integer, check_number, check_positive
from cvkern._runtime import Runtime, runtime
from cvkern._whites import white_of
from cvkern.features._photographs import as_host, check_photograph, prepared
from cvkern.features.keypoints import Features
from cvkern.features.matching import match_descriptors
from cvkern.geometry.fitting import scaled
from cvkern.geometry.maps import find_homography
from cvkern.panorama.registration import keypoints_of, mapped, resized, to_small
from cvkern.transform.projective import is_singular, warp_perspective

# Distance of a point from where the first homography puts it, in parts of the longest side.
NEAR, LEAST_NEAR = 0.01, 8.0  # and at least so many pixels
OCTAVES = 0.6  # largest difference of the scales of matched points
BORDER = 2.0  # pixels: points closer to the end of a drawn photograph are not matched
STRICT = 0.8  # ratio of matches that are taken if those of `max_ratio` have no homography
GROWTH = 1.5  # times the matches of a first homography are found again, or it is wrong
FEW = 8  # matches; fewer are no better than those of the first homography
# Keypoints err in proportion to their scale, and by some tenths of a pixel whatever it is. The
# first steps allow more, because the first homography is far from many of its matches.
NOISE = ((0.2, 0.3),) * 9 + ((0.1, 0.2),) * 6
WIDEST = 2.0  # times the threshold: farther matches do not count
COARSE = 0.7  # a photograph drawn below this size is shrunk first


class PhotographMatches(NamedTuple):
    """Matches of two photographs of a plane, or from one place."""

    matrix: np.ndarray | None
    """(3, 3) float64, maps (x, y, 1) of the first photograph to the second, x the column and y the
    row; None if no homography explains more matches than chance, and is confirmed by as many and
    half as many more."""
    points0: np.ndarray
    """(N, 2) float64, rows and columns in the first photograph."""
    points1: np.ndarray
    """The same points in the second photograph."""


class _Points(NamedTuple):
    """Keypoints on the host."""

    places: np.ndarray
    """(N, 2) float64, x and y."""
    squares: np.ndarray
    """(N,) float64, squared scales."""
    descriptors: np.ndarray
    """(N, 128) uint8."""


class _Matches(NamedTuple):
    """Matches of keypoints, on the host."""

    points0: np.ndarray
    """(N, 2) float64, x and y in the first photograph."""
    points1: np.ndarray
    """The same points in the second photograph."""
    squares: np.ndarray
    """(N,) float64: squared scales of both keypoints, in pixels of the second photograph."""


class _Guess(NamedTuple):
    """A first homography."""

    matrix: np.ndarray
    inliers: np.ndarray
    """Matches that the homography explains, indices of keypoints (N, 2)."""


@compiles_ahead("geometry.find_homography", "features.match_descriptors")
def match_photographs(
    image0: Any,
    image1: Any,
    threshold: float = 3.0,
    *,
    max_keypoints: int = 2000,
    max_ratio: float = 0.9,
    data_range: float | None = None,
    seed: int = 0,
) -> PhotographMatches:
    """Match two photographs of a plane, or from one place, and find their homography.

    SIFT keypoints are matched by their descriptors, and :func:`find_homography` gives a first
    homography. Each photograph is then drawn as the other one sees it. Keypoints of the drawn one
    have the scale, turn and shape of those of the other, so that many more are found again, closer
    to their place. They are matched near where the first homography puts them, and the last one
    weighs each by the noise that keypoints of its scale have.

    Parameters
    ----------
    image0, image1 : arrays of shape (H, W), (H, W, 3) or (H, W, 4)
        Photographs of any real dtype, of one library. Sizes may differ.
    threshold : float, default 3.0
        Largest distance of a match from its mapped point, in pixels of `image1`.
    max_keypoints : int, default 2000
        Keypoints of each photograph: those with the largest response.
    max_ratio : float, default 0.9
        Largest ratio of the distances of the nearest and the second nearest descriptor, for the
        first homography; in (0, 1].
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.
    seed : int, default 0
        Seed of the random samples.

    Returns
    -------
    PhotographMatches
        Named tuple of `matrix`, `points0` and `points1`: matches within the threshold.

    Raises
    ------
    TypeError
        If a photograph does not hold real numbers.
    ValueError
        If a photograph is empty or has a wrong shape, an option is out of range, or the arrays are
        on several devices.

    Notes
    -----
    The last homography minimises the sum over matches of ``e^2 / (1 + e^2)``, where e^2 is the
    squared distance over the sum of the squares of 0.1 scales and of 0.2 pixels, by Gauss-Newton
    steps in float64. Matches of another plane, a few pixels off, hardly count in that sum [2]_.

    References
    ----------
    .. [1] D. Mishkin, J. Matas and M. Perdoch, "MODS: Fast and robust method for two-view
       matching", CVIU 141, 2015: matching of photographs drawn from other views.
    .. [2] S. Geman and D. McClure, "Statistical methods for tomographic image reconstruction",
       Bulletin of the International Statistical Institute 52(4), 1987.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> from skimage import data
    >>> photo = data.camera()
    >>> tilt = np.array([[0.8, 0.1, 20], [-0.1, 0.9, 60], [2e-4, 1e-4, 1]])
    >>> other = cvkern.warp_perspective(photo, tilt, dtype=np.uint8)
    >>> found = cvkern.match_photographs(photo, other)
    >>> corners = np.array([[0, 511, 0, 511], [0, 0, 511, 511], [1, 1, 1, 1]])
    >>> there, wanted = found.matrix @ corners, tilt @ corners
    >>> bool(np.abs(there / there[2] - wanted / wanted[2]).max() < 0.2)
    True
    """
    threshold = check_positive(threshold, "threshold")
    max_keypoints = check_integer(max_keypoints, "max_keypoints", 1, 2**20)
    max_ratio = check_number(max_ratio, "max_ratio")
    if not 0 < max_ratio <= 1:
        raise ValueError(f"max_ratio must be in (0, 1], got {max_ratio:g}")
    seed = check_integer(seed, "seed", 0, 2**31 - 1)
    images = [
        check_photograph(image, None, None, name)[0]
        for image, name in ((image0, "image0"), (image1, "image1"))
    ]
    whites = [white_of(image, data_range) for image in images]
    rt = runtime(*images)
    grays = [_gray(rt, *given) for given in zip(images, whites, strict=True)]
    found = [keypoints_of(gray, max_keypoints, data_range=1.0) for gray in grays]
    points = [_on_host(rt, features) for features in found]
    for guess in _guesses(rt, found, points, (max_ratio, threshold, seed)):
        matrix, matches, count = _seen_again(rt, grays, points, guess, (max_keypoints, threshold))
        if count >= GROWTH * len(guess.inliers):
            there, seen = (p[:, ::-1].copy() for p in matches[:2])
            return PhotographMatches(scaled(matrix), there, seen)
    none = np.zeros((0, 2))
    return PhotographMatches(None, none, none)


def _guesses(
    rt: Runtime, found: list[Features], points: list[_Points], options: tuple[float, float, int]
) -> Iterator[_Guess]:
    """Yield first homographies.

    Few keypoints of a photograph that shows all at a fraction of the size are found in the other:
    most are among the matches of a small ratio, and where the distance is that in the larger one,
    a threshold leaves fewer wrong ones.
    """
    max_ratio, threshold, seed = options
    one, other = points
    for strict in (False, True):
        ratio = min(max_ratio, STRICT) if strict else max_ratio
        pairs = match_descriptors(found[0].descriptors, found[1].descriptors, ratio)
        pairs = as_host(rt, pairs)
        places = [one.places[pairs[:, 0], ::-1], other.places[pairs[:, 1], ::-1]]
        for backwards in (False, True) if strict else (False,):
            source, target = reversed(places) if backwards else places
            fit = find_homography(source, target, threshold, seed=seed)
            if fit.matrix is None or _is_flat(fit.matrix):
                continue
            matrix = np.linalg.inv(fit.matrix) if backwards else fit.matrix
            inliers = pairs[np.asarray(fit.inliers)]
            # Among few matches the wrong ones would count too much.
            used = _joined(matrix, one, other, *(inliers if strict else pairs).T)
            matrix = _refined(matrix, used, threshold)
            if not _is_flat(matrix):
                yield _Guess(matrix, inliers)


def _is_flat(matrix: np.ndarray) -> bool:
    """Tell whether a homography or its inverse takes a photograph nearly to a line."""
    return is_singular(matrix) or is_singular(np.linalg.inv(matrix))


def _seen_again(
    rt: Runtime,
    grays: list[Any],
    points: list[_Points],
    guess: _Guess,
    options: tuple[int, float],
) -> tuple[np.ndarray, _Matches, int]:
    """Match each photograph, drawn as the other one sees it.

    Return the last homography, its matches, and their number with those that both drawings have.
    """
    max_keypoints, threshold = options
    one, other = points
    farthest = int(_distances(one, other, *guess.inliers.T).max())
    matrix = guess.matrix
    near = []
    for side, there in ((0, matrix), (1, np.linalg.inv(matrix))):
        source, target = grays[side], grays[1 - side]
        sides = tuple(source.shape), tuple(target.shape)
        view, mask = _drawn(rt, source, there, sides[1])
        drawn = keypoints_of(view, max_keypoints, mask=mask, data_range=1.0)
        near.append(_near(_on_host(rt, drawn), points[1 - side], there, sides, farthest))
    seen, back = near
    growth = _growth(matrix, back.points1)
    back = _Matches(back.points1, back.points0, back.squares * growth)
    rows = np.concatenate([np.column_stack(part) for part in (seen, back)])
    # A keypoint with several orientations is there once.
    rows, counts = np.unique(rows, axis=0, return_counts=True)
    last = _Matches(rows[:, :2], rows[:, 2:4], rows[:, 4])
    matrix = _refined(matrix, last, threshold)
    apart = mapped(matrix, last.points0)[0] - last.points1
    good = np.hypot(*apart.T) < threshold
    return matrix, _Matches(*(part[good] for part in last)), int(counts[good].sum())


def _gray(rt: Runtime, image: Any, white: float) -> Any:
    """Return the grey of a photograph in parts of white, as an array of its library."""
    gray = rt.empty(tuple(image.shape[:2]), np.float32)
    prepared(rt, image, white, rt.adopt(gray, np.float32))
    return rt.release(gray)


def _on_host(rt: Runtime, found: Features) -> _Points:
    places, scales, descriptors = (
        as_host(rt, a) for a in (found.points, found.scales, found.descriptors)
    )
    return _Points(places[:, ::-1].astype(np.float64), scales**2.0, descriptors)


def _distances(one: _Points, other: _Points, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return squared distances of descriptors."""
    apart = one.descriptors[i].astype(np.int32) - other.descriptors[j]
    return (apart**2).sum(axis=1)


def _drawn(rt: Runtime, image: Any, matrix: np.ndarray, shape: tuple[int, ...]) -> tuple[Any, Any]:
    """Return a photograph as the other camera sees it, and a mask of the pixels that it sees."""
    height, width = image.shape
    middle = np.array([[(width - 1) / 2, (height - 1) / 2]])
    size = math.sqrt(_growth(matrix, middle)[0])
    if size < COARSE:
        sides = max(1, round(height * size)), max(1, round(width * size))
        image = resized(image, sides)
        matrix = matrix @ np.linalg.inv(to_small(np.array([sides[1] / width, sides[0] / height])))
    whole = rt.give(np.full(tuple(image.shape), 255, np.uint8))
    mask = warp_perspective(whole, matrix, shape, dtype=np.uint8)
    return warp_perspective(image, matrix, shape, mode="nearest"), mask


def _near(
    drawn: _Points, other: _Points, matrix: np.ndarray, sides: Any, farthest: int
) -> _Matches:
    """Match keypoints of a drawn photograph with those of the photograph that it was drawn as.

    A match is a pair of points at about the same place and of about the same scale, of which each
    is the other's nearest descriptor among all such pairs.
    """
    from scipy.spatial import KDTree

    source, target = sides
    back, depth = mapped(np.linalg.inv(matrix), drawn.places)
    last = np.array(source[::-1]) - 1.0 - BORDER
    inside = (depth > 0) & ((back >= BORDER) & (back <= last)).all(axis=1)
    radius = max(LEAST_NEAR, NEAR * max(target))
    close = KDTree(drawn.places).sparse_distance_matrix(
        KDTree(other.places), radius, output_type="coo_matrix"
    )
    i, j = close.row, close.col
    alike = np.abs(np.log2(drawn.squares[i] / other.squares[j])) < 2 * OCTAVES
    kept = inside[i] & alike
    i, j = i[kept], j[kept]
    distances = _distances(drawn, other, i, j)
    least = [np.full(len(p.places), farthest + 1) for p in (drawn, other)]
    np.minimum.at(least[0], i, distances)
    np.minimum.at(least[1], j, distances)
    kept = (distances == least[0][i]) & (distances == least[1][j])
    i, j = i[kept], j[kept]
    return _Matches(back[i], other.places[j], drawn.squares[i] + other.squares[j])


def _growth(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the factors by which a homography enlarges areas at points (N, 2)."""
    depth = points @ matrix[2, :2] + matrix[2, 2]
    with np.errstate(divide="ignore", over="ignore"):
        return np.abs(np.linalg.det(matrix) / depth**3)


def _refined(matrix: np.ndarray, matches: _Matches, threshold: float) -> np.ndarray:
    """Return the homography after steps of least squares, in which far matches count little."""
    if len(matches.squares) < FEW:
        return matrix
    # Centred points of unit size, so that all elements of the matrix are of one order.
    middle = matches.points0.mean(axis=0)
    size = max(float(matches.points0.std()), 1e-6)
    to_unit = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, size]]) / size
    ones = np.ones((len(matches.squares), 1))
    rays = np.hstack(((matches.points0 - middle) / size, ones))
    h = matrix @ np.linalg.inv(to_unit)
    h = h / np.linalg.norm(h)
    for per_scale, least in NOISE:
        noise = per_scale**2 * matches.squares + least**2
        depth = rays @ h[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            there = (rays @ h[:2].T) / depth[:, None]
            rays_seen = rays / depth[:, None]
        apart = there - matches.points1
        square = (apart**2).sum(axis=1)
        counts = square < (WIDEST * threshold) ** 2
        weights = 1 / (noise[counts] * (1 + square[counts] / noise[counts]) ** 2)
        a, p, r = rays_seen[counts], there[counts], apart[counts]
        zero = np.zeros_like(a)
        normal, right = np.zeros((9, 9)), np.zeros(9)
        for k, rows in enumerate((np.hstack((a, zero)), np.hstack((zero, a)))):
            rows = np.hstack((rows, -a * p[:, k : k + 1]))
            weighed = rows.T * weights
            normal += weighed @ rows
            right += weighed @ r[:, k]
        # The scale of the matrix is free: fix it.
        normal += np.trace(normal) * np.outer(h, h)
        try:
            step = np.linalg.solve(normal, right).reshape(3, 3)
        except np.linalg.LinAlgError:
            return matrix
        h = h - step
        h = h / np.linalg.norm(h)
    found = h @ to_unit
    return found if np.isfinite(found).all() else matrix


def _joined(
    matrix: np.ndarray, one: _Points, other: _Points, i: np.ndarray, j: np.ndarray
) -> _Matches:
    """Return matches of keypoints of the photographs themselves."""
    squares = one.squares[i] * _growth(matrix, one.places[i]) + other.squares[j]
    return _Matches(one.places[i], other.places[j], squares)
