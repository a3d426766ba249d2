"""Robust fits of homographies, affine maps and similarities to matches with outliers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern.geometry._batches import check_batch, search_options
from cvkern.geometry._matches import gather
from cvkern.geometry.fitting import scaled
from cvkern.geometry.robust import Explorer, RobustFit, RobustFits, Search, alone
from cvkern.kernels.codes.geometry import Model


def find_homography(
    points0: Any,
    points1: Any,
    threshold: float = 3.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFit:
    """Find the homography that many of the given matches support.

    Samples of four matches give hypotheses. A preview of 64 matches selects the best of each group
    of 64 hypotheses, which is then scored on all matches by squared distances, truncated at the
    threshold. The best ones are refined by least squares over their inliers, in float64, and the
    one with the least cost wins. The result depends on the set of matches, not on their order, and
    is the same on every device. Equal matches count once.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image. Matches that are not finite are outliers.
    points1 : array of shape (N, 2)
        Row and column of the matching points in the second image.
    threshold : float, default 3.0
        Largest distance of an inlier from its mapped point, in pixels of the second image.
    confidence : float, default 0.999
        The search ends when, with this probability, it would have found a model with 1.5 times as
        many inliers; in (0, 1).
    max_trials : int, default 32768
        Largest number of samples for a pair, rounded up to whole groups of 64.
    seed : int, default 0
        Seed of the random samples.

    Returns
    -------
    RobustFit
        Named tuple of `matrix`, `inliers` and `cost`. The matrix is None if there is no such map,
        or if chance alone explains as many inliers.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches of a pair, arrays are on
        several devices, or an option is out of range.

    References
    ----------
    O. Chum, J. Matas and J. Kittler, "Locally optimized RANSAC", DAGM 2003; P. Torr and
    A. Zisserman, "MLESAC", CVIU 78(1), 2000 (the truncated cost); L. Moisan and B. Stival, "A
    probabilistic criterion to detect rigid point matches", IJCV 57(3), 2004 (what chance explains).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points0 = rng.uniform(0, 500, (100, 2))
    >>> points1 = points0 + (20, 30)
    >>> points1[:40] = rng.uniform(0, 500, (40, 2))
    >>> fit = cvkern.find_homography(points0, points1)
    >>> fit.matrix.round(4) + 0
    array([[ 1.,  0., 30.],
           [ 0.,  1., 20.],
           [ 0.,  0.,  1.]])
    >>> int(fit.inliers.sum()), fit.cost
    (60, 40.0)
    """
    options = search_options(threshold, confidence, max_trials, seed)
    return alone(find_many([(points0, points1)], Model.HOMOGRAPHY, options))


def find_homographies(
    pairs: Sequence[tuple[Any, Any]],
    threshold: float = 3.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFits:
    """Find the homography of each of several pairs of images, all at once.

    Each is what :func:`find_homography` finds for the pair alone. A pair without a
    result, because of too few matches or numbers that are not finite, does not affect the others.

    Parameters
    ----------
    pairs : sequence of pairs of arrays of shape (N, 2)
        Row and column in the first and in the second image. N may differ between pairs.
    threshold : float, default 3.0
        Largest distance of an inlier from its mapped point, in pixels of the second image.
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
        If a shape does not match, there are more than 262144 matches of a pair, arrays are on
        several devices, or an option is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> points = np.random.default_rng(0).uniform(0, 500, (50, 2))
    >>> fits = cvkern.find_homographies([(points, points + 5), (points[:3], points[:3])])
    >>> fits.matrices[0].round(4) + 0
    array([[1., 0., 5.],
           [0., 1., 5.],
           [0., 0., 1.]])
    >>> bool(np.isnan(fits.matrices[1]).all()), fits.offsets.tolist(), fits.costs.tolist()
    (True, [0, 50, 53], [0.0, 3.0])
    """
    return find_many(
        pairs, Model.HOMOGRAPHY, search_options(threshold, confidence, max_trials, seed)
    )


def find_affine(
    points0: Any,
    points1: Any,
    threshold: float = 3.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFit:
    """Find the affine map that many of the given matches support.

    As :func:`find_homography`, from samples of three matches; the last row is (0, 0, 1).

    Parameters
    ----------
    points0, points1 : array of shape (N, 2)
        Row and column in the first image, and of the matching points in the second one.
    threshold : float, default 3.0
        Largest distance of an inlier from its mapped point, in pixels of the second image.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    RobustFit
        As in :func:`find_homography`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches of a pair, arrays are on
        several devices, or an option is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points0 = rng.uniform(0, 500, (50, 2))
    >>> points1 = points0 * 2
    >>> points1[:20] = rng.uniform(0, 500, (20, 2))
    >>> cvkern.find_affine(points0, points1).matrix.round(4) + 0
    array([[2., 0., 0.],
           [0., 2., 0.],
           [0., 0., 1.]])
    """
    options = search_options(threshold, confidence, max_trials, seed)
    return alone(find_many([(points0, points1)], Model.AFFINE, options))


def find_similarity(
    points0: Any,
    points1: Any,
    threshold: float = 3.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFit:
    """Find the similarity that many of the given matches support.

    As :func:`find_homography`, from samples of two matches: rotation, scale and translation,
    never a mirror image; the last row is (0, 0, 1).

    Parameters
    ----------
    points0, points1 : array of shape (N, 2)
        Row and column in the first image, and of the matching points in the second one.
    threshold : float, default 3.0
        Largest distance of an inlier from its mapped point, in pixels of the second image.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    RobustFit
        As in :func:`find_homography`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches of a pair, arrays are on
        several devices, or an option is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points0 = rng.uniform(0, 500, (50, 2))
    >>> points1 = points0 * 2
    >>> points1[:20] = rng.uniform(0, 500, (20, 2))
    >>> cvkern.find_similarity(points0, points1).matrix.round(4) + 0
    array([[2., 0., 0.],
           [0., 2., 0.],
           [0., 0., 1.]])
    """
    options = search_options(threshold, confidence, max_trials, seed)
    return alone(find_many([(points0, points1)], Model.SIMILARITY, options))


def find_many(pairs: Sequence[tuple[Any, Any]], model: Model, options: Search) -> RobustFits:
    """Check the pairs of a batch, and fit a map to each."""
    batched = check_batch(pairs)
    batch = gather(batched.rt, batched.points)
    explorer = Explorer(batched.rt, batch, options)
    matrices, marks, costs = explorer.finish(model, explorer.explore(model))
    matrices = np.linalg.inv(batch.to_unit[1]) @ matrices @ batch.to_unit[0]
    return batched.fits(batch, scaled(matrices), marks, costs)
