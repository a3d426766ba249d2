"""Robust fits of essential matrices to matches of calibrated cameras."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern.geometry._batches import check_batch, search_options
from cvkern.geometry._matches import gather
from cvkern.geometry._matrices import check_cameras
from cvkern.geometry.robust import Explorer, RobustFit, RobustFits, Search, alone
from cvkern.kernels.codes.geometry import Model


def find_essential(
    points0: Any,
    points1: Any,
    K0: Any,
    K1: Any,
    threshold: float = 1.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFit:
    """Find the essential matrix that many of the given matches support.

    Like :func:`find_fundamental`, but for two calibrated cameras and with samples of five matches.
    :func:`recover_pose` computes the pose from the matrix. Planar scenes are no problem.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image. Matches that are not finite are outliers.
    points1 : array of shape (N, 2)
        Row and column of the matching points in the second image.
    K0, K1 : array of shape (3, 3)
        Camera matrices of the first and of the second image; they act on (x, y, 1).
    threshold : float, default 1.0
        Largest Sampson distance of an inlier, pixels.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    RobustFit
        Named tuple of `matrix`, `inliers` and `cost`. The matrix acts on points K^-1 (x, y, 1) and
        has the singular values 1, 1 and 0. It is None if there are fewer than six inliers, or if
        chance alone explains as many.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches, a camera matrix is not finite
        or has no inverse, arrays are on several devices, or an option is out of range.

    References
    ----------
    D. Nister, "An efficient solution to the five-point relative pose problem", IEEE PAMI 26(6),
    2004.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rng = np.random.default_rng(0)
    >>> scene = rng.uniform((-1, -1, 4), (1, 1, 8), (60, 3))
    >>> def seen(points):
    ...     q = points @ camera.T
    ...     return q[:, 1::-1] / q[:, 2:]  # rows, columns
    >>> points0, points1 = seen(scene), seen(scene + (1, 0, 0))
    >>> points1[:20] = rng.uniform(0, 480, (20, 2))
    >>> fit = cvkern.find_essential(points0, points1, camera, camera)
    >>> pose = cvkern.recover_pose(
    ...     fit.matrix, points0[fit.inliers], points1[fit.inliers], camera, camera)
    >>> (pose.translation.round(4) + 0).tolist()
    [1.0, 0.0, 0.0]
    """
    options = search_options(threshold, confidence, max_trials, seed)
    return alone(_find([(points0, points1)], K0, K1, options))


def find_essentials(
    pairs: Sequence[tuple[Any, Any]],
    K0: Any,
    K1: Any,
    threshold: float = 1.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> RobustFits:
    """Find the essential matrix of each of several pairs of images, all at once.

    Each is what :func:`find_essential` finds for the pair alone. A pair without a
    result, because of too few matches or numbers that are not finite, does not affect the others.

    Parameters
    ----------
    pairs : sequence of pairs of arrays of shape (N, 2)
        Row and column in the first and in the second image. N may differ between pairs.
    K0, K1 : array of shape (3, 3) or (B, 3, 3)
        Camera matrices of the first and of the second image of all pairs, or of each.
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
        If there is no pair, a shape does not match, there are more than 262144 matches of a pair, a
        camera matrix is not finite or has no inverse, arrays are on several devices, or an option
        is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform(0, 500, (50, 2))
    >>> moved = points + np.stack((np.zeros(50), rng.uniform(3, 90, 50)), 1)
    >>> camera = np.diag((500.0, 500.0, 1.0))
    >>> fits = cvkern.find_essentials([(points, moved), (points[:3], moved[:3])], camera, camera)
    >>> bool(fits.inliers[:50].all()), bool(np.isnan(fits.matrices[1]).all())
    (True, True)
    """
    return _find(pairs, K0, K1, search_options(threshold, confidence, max_trials, seed))


def _find(pairs: Sequence[tuple[Any, Any]], K0: Any, K1: Any, options: Search) -> RobustFits:
    batched = check_batch(pairs)
    cameras = [check_cameras(K, len(batched.points), name) for K, name in ((K0, "K0"), (K1, "K1"))]
    batch = gather(batched.rt, batched.points, alike=True)
    back = batch.to_unit @ np.stack(cameras)  # from rays to scaled points, (2, P, 3, 3)
    known = np.concatenate((np.linalg.inv(back), back)).swapaxes(0, 1).reshape(-1, 36)
    explorer = Explorer(batched.rt, batch, options, np.ascontiguousarray(known))
    matrices, marks, costs = explorer.finish(Model.ESSENTIAL, explorer.explore(Model.ESSENTIAL))
    matrices = back[1].swapaxes(1, 2) @ matrices @ back[0]
    return batched.fits(batch, equalised(matrices), marks, costs)


def equalised(matrices: np.ndarray) -> np.ndarray:
    """Return the nearest matrices with singular values 1, 1 and 0, up to scale; keep NaN."""
    found = np.full(matrices.shape, np.nan)
    known = np.isfinite(matrices).all(axis=(-2, -1))
    u, _, vt = np.linalg.svd(matrices[known])
    found[known] = u[..., :2] @ vt[..., :2, :]
    return found
