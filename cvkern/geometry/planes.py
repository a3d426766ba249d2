"""Several homographies of one pair of images: the planes of a scene."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_integer, check_number
from cvkern._runtime import Runtime
from cvkern.geometry._batches import batch_of, search_options
from cvkern.geometry._matches import gather
from cvkern.geometry._points import check_pairs
from cvkern.geometry.fitting import scaled
from cvkern.geometry.robust import Explorer, Search
from cvkern.kernels.codes.geometry import MAX_MATCHES, SAMPLE, Model

NEIGHBOURS = 6  # nearest matches of a match, which should have the same label
ROUNDS, SWEEPS = 6, 10  # rounds of labels and fits; sweeps over the labels in a round
NARROW = 0.5  # threshold of the first planes, over the caller's; it keeps neighbours apart
MOST = 4.0  # largest cost of a match for a plane; the cost of an outlier is 1


class Planes(NamedTuple):
    """The homographies of several planes."""

    matrices: np.ndarray
    """(P, 3, 3) float64, the plane with most matches first; each matrix acts on (x, y, 1)."""
    labels: Any
    """(N,) int32, in the library of the points: the plane of each match, -1 for none."""


def find_planes(
    points0: Any,
    points1: Any,
    threshold: float = 4.0,
    *,
    min_inliers: int = 12,
    smoothness: float = 0.2,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> Planes:
    """Find the homographies of all planes with enough of the given matches.

    Planes are found one after the other among the remaining matches. Then labels and homographies
    are improved in turns. A match gets the plane with the least cost: its squared distance plus
    `smoothness` for each neighbour with a different label. Each plane is then fitted to its
    matches. The result depends on the set of matches, not on their order.

    Parameters
    ----------
    points0 : array of shape (N, 2)
        Row and column in the first image. Matches that are not finite are outliers.
    points1 : array of shape (N, 2)
        Row and column of the matching points in the second image.
    threshold : float, default 4.0
        Largest distance of a match from its plane, pixels: the root mean square of the distances in
        both images. It may be larger for a match whose neighbours have the same label.
    min_inliers : int, default 12
        Least number of different matches of a plane, >= 5.
    smoothness : float, default 0.2
        Cost of a neighbour with a different label, >= 0. The cost of an outlier is 1.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    Planes
        Named tuple of `matrices` and `labels`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches, arrays are on several
        devices, or an option is out of range.

    References
    ----------
    H. Isack and Y. Boykov, "Energy-based geometric multi-model fitting", IJCV 97(2), 2012.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> points = np.random.default_rng(0).uniform(0, 500, (100, 2))
    >>> left = points[:, 1] < 250
    >>> moved = np.where(left[:, None], points + 20, 1.1 * points - 9)
    >>> planes = cvkern.find_planes(points, moved)
    >>> len(planes.matrices), [len(set(planes.labels[side].tolist())) for side in (left, ~left)]
    (2, [1, 1])
    """
    options = search_options(threshold, confidence, max_trials, seed)
    least = check_integer(min_inliers, "min_inliers", 5, MAX_MATCHES)
    smoothness = check_number(smoothness, "smoothness", low=0)
    batched = batch_of([check_pairs(points0, points1)], "points0")
    given = np.concatenate(batched.points[0], axis=1)
    finite = np.isfinite(given).all(axis=1)
    # Every order of the same matches, however often each, is the same work.
    matches, places = np.unique(given[finite], axis=0, return_inverse=True)
    finder = _Finder(batched.rt, matches, options, least)
    matrices, found = _improved(finder, finder.one_by_one(), smoothness)
    order = np.argsort(-np.bincount(found[found >= 0], minlength=len(matrices)), kind="stable")
    ranks = np.append(np.argsort(order), -1).astype(np.int32)  # the last for -1
    labels = np.full(len(given), -1, np.int32)
    labels[finite] = ranks[found][places.ravel()]
    kept = np.stack([scaled(matrices[i]) for i in order]) if matrices else np.empty((0, 3, 3))
    return Planes(kept, batched.rt.give(labels))


class _Finder:
    """Finds homographies among some of the matches of a pair."""

    def __init__(self, rt: Runtime, matches: np.ndarray, options: Search, least: int):
        self.rt, self.matches, self.options, self.least = rt, matches, options, least

    def plane(self, chosen: np.ndarray, share: float) -> np.ndarray | None:
        """Return the homography of most of the matches chosen, if there is one."""
        points = self.matches[chosen]
        if len(points) < max(self.least, SAMPLE[Model.HOMOGRAPHY] + 1):
            return None
        options = self.options._replace(threshold=share * self.options.threshold)
        batch = gather(self.rt, [(points[:, :2], points[:, 2:])])
        explorer = Explorer(self.rt, batch, options)
        matrices, marks, _ = explorer.finish(Model.HOMOGRAPHY, explorer.explore(Model.HOMOGRAPHY))
        matrix = np.linalg.inv(batch.to_unit[1, 0]) @ matrices[0] @ batch.to_unit[0, 0]
        enough = np.isfinite(matrix).all() and (marks[: batch.spans[0, 1]] != 0).sum() >= self.least
        return matrix if enough and abs(np.linalg.det(matrix)) > 0 else None

    def squares(self, matrix: np.ndarray) -> np.ndarray:
        """Return mean squared distances in both images, over the square of the threshold, (N,)."""
        total = np.zeros(len(self.matches))
        a, b = self.matches[:, 1::-1], self.matches[:, :1:-1]
        for h, p, q in ((matrix, a, b), (np.linalg.inv(matrix), b, a)):
            with np.errstate(all="ignore"):
                mapped = np.c_[p, np.ones(len(p))] @ h.T
                total += ((mapped[:, :2] / mapped[:, 2:] - q) ** 2).sum(axis=1)
        return np.nan_to_num(total / 2, nan=np.inf) / self.options.threshold**2

    def one_by_one(self) -> list[np.ndarray]:
        found, left = [], np.arange(len(self.matches))
        # Each round takes out `least` matches or more, or ends.
        while (matrix := self.plane(left, NARROW)) is not None:
            outside = self.squares(matrix)[left] >= NARROW**2
            if outside.sum() > len(left) - self.least:
                break
            found.append(matrix)
            left = left[outside]
        return found


def _improved(
    finder: _Finder, matrices: list[np.ndarray], smoothness: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """Label matches and fit planes in turns; return matrices and labels, -1 for outliers."""
    count = len(finder.matches)
    labels = np.full(count, -1)
    if not matrices:
        return matrices, labels
    beside = _neighbours(finder.matches)
    for _ in range(ROUNDS):
        if not matrices:
            break
        squares = [finder.squares(m) for m in matrices]
        costs = np.minimum(np.stack([*squares, np.ones(count)], 1), MOST)
        labels = costs.argmin(axis=1)  # the last is none
        for _ in range(SWEEPS):
            same = beside @ np.eye(costs.shape[1])[labels]
            now = (costs - smoothness * same).argmin(axis=1)
            if (now == labels).all():
                break
            labels = now
        fitted = [finder.plane(np.flatnonzero(labels == i), 1.0) for i in range(len(matrices))]
        kept = [i for i, matrix in enumerate(fitted) if matrix is not None]
        renamed = np.full(len(matrices) + 1, -1)
        renamed[kept] = np.arange(len(kept))
        labels, matrices = renamed[labels], [m for m in fitted if m is not None]
    return matrices, labels


def _neighbours(matches: np.ndarray) -> Any:
    """Return a sparse matrix (N, N): 1 where either is among the nearest of the other, scaled."""
    import scipy.sparse
    import scipy.spatial

    count = len(matches)
    number = min(NEIGHBOURS, count - 1)
    found: Any = scipy.spatial.KDTree(matches).query(matches, number + 1)
    near = found[1][:, 1:]
    rows = np.repeat(np.arange(count), number)
    ones = np.ones(len(rows))
    graph: Any = scipy.sparse.csr_array((ones, (rows, near.ravel())), (count, count))
    graph = graph.maximum(graph.T)
    scale: Any = scipy.sparse.diags_array(NEIGHBOURS / graph.sum(axis=1))
    return (scale @ graph).tocsr()
