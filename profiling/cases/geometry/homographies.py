"""Homographies between matches with outliers: a batch of pairs, and one pair."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import cvkern
from profiling.case import TOY, Case, Peer, Shape, Work

WIDTH, HEIGHT = 1000, 750
CORNERS = np.array(
    [[0, 0], [WIDTH - 1, 0], [WIDTH - 1, HEIGHT - 1], [0, HEIGHT - 1]], float
)  # x, y
THRESHOLD, NOISE = 3.0, 1.0  # pixels
# Mean corner error of a good fit to 400 inliers or more with that noise, the largest of 100 pairs.
LIMIT = 1.0

Arrays = tuple[np.ndarray, ...]


def _map(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    q = np.concatenate((points, np.ones_like(points[..., :1])), -1) @ np.swapaxes(matrix, -1, -2)
    return q[..., :2] / q[..., 2:]


def _inputs(
    pairs: int, outliers: float, matches: int = 2000
) -> Callable[[Shape, np.random.Generator], Arrays]:
    def make(shape: Shape, rng: np.random.Generator) -> Arrays:
        """Points (P, N, 2) of both images as (row, column), and where the corners are mapped."""
        count, number = (min(pairs, 3), 200) if shape == TOY else (pairs, matches)
        moved = CORNERS + rng.uniform(-150, 150, (count, 4, 2))
        maps = np.stack([cvkern.fit_homography(CORNERS[:, ::-1], m[:, ::-1]) for m in moved])
        a = rng.uniform(0, (WIDTH, HEIGHT), (count, number, 2))
        b = _map(maps, a) + rng.normal(0, NOISE, a.shape)
        wild = np.argsort(rng.random((count, number)), 1) < round(outliers * number)
        b[wild] = rng.uniform(0, (WIDTH, HEIGHT), (int(wild.sum()), 2))
        return np.ascontiguousarray(a[..., ::-1]), np.ascontiguousarray(b[..., ::-1]), moved

    return make


def _corners(matrices: Any) -> Arrays:
    return (np.stack([_map(np.asarray(m), CORNERS) for m in matrices]),)


def _batch(a: Any, b: Any, corners: Any) -> Arrays:
    fits = cvkern.find_homographies(list(zip(a, b, strict=True)), THRESHOLD)
    return _corners(fits.matrices)


def _many(a: Any, b: Any, corners: Any) -> Arrays:
    """Draw 1000 hypotheses for every pair."""
    pairs = list(zip(a, b, strict=True))
    fits = cvkern.find_homographies(pairs, THRESHOLD, max_trials=1000, confidence=1 - 1e-12)
    return _corners(fits.matrices)


def _single(a: Any, b: Any, corners: Any) -> Arrays:
    return _corners(
        [cvkern.find_homography(p, q, THRESHOLD).matrix for p, q in zip(a, b, strict=True)]
    )


def _worst(ours: Arrays, right: Arrays) -> float:
    """The largest mean corner error of a pair, pixels."""
    return float(np.linalg.norm(ours[0] - right[0], axis=-1).mean(axis=-1).max())


def _peer(find: Callable[[Any, np.ndarray, np.ndarray], Any]) -> Callable[..., Arrays]:
    def call(module: Any, a: np.ndarray, b: np.ndarray, corners: np.ndarray) -> Arrays:
        x, y = (np.ascontiguousarray(p[..., ::-1]) for p in (a, b))
        return _corners([find(module, p, q) for p, q in zip(x, y, strict=True)])

    return call


def _magsac(cv2: Any, a: np.ndarray, b: np.ndarray) -> Any:
    return cv2.findHomography(a, b, cv2.USAC_MAGSAC, THRESHOLD)[0]


def _poselib(poselib: Any, a: np.ndarray, b: np.ndarray) -> Any:
    return poselib.estimate_homography(a, b, {"max_reproj_error": THRESHOLD})[0]


def _degensac(pydegensac: Any, a: np.ndarray, b: np.ndarray) -> Any:
    return pydegensac.findHomography(a, b, THRESHOLD)[0]


def _case(
    name: str, title: str, pairs: int, outliers: float, call: Any, matches: int = 2000
) -> Case:
    return Case(
        name=name,
        title=title,
        image=_inputs(pairs, outliers, matches),
        call=call,
        oracle=lambda a, b, corners: (corners,),
        oracle_name="the corners of the map that made the matches",
        difference=_worst,
        tolerance=LIMIT,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=(
            Peer("OpenCV, MAGSAC", "cv2", _peer(_magsac)),
            Peer("PoseLib", "poselib", _peer(_poselib)),
            Peer("pydegensac", "pydegensac", _peer(_degensac)),
        ),
        captures=False,
        work=Work("pairs", lambda a, b, corners: float(len(a))),
        sizes=("VGA",),  # points know no size
        most_inputs=2,
        margin=0,
    )


CASES = (
    _case("homographies_50", "100 homographies, 2000 matches, 50 % outliers", 100, 0.5, _batch),
    _case("homographies_80", "100 homographies, 2000 matches, 80 % outliers", 100, 0.8, _batch),
    _case(
        "homographies_1000",
        "1000 homographies, 1000 matches, 65 % outliers, 1000 hypotheses each",
        1000,
        0.65,
        _many,
        1000,
    ),
    _case("homography_50", "One homography, 2000 matches, 50 % outliers", 1, 0.5, _single),
)
