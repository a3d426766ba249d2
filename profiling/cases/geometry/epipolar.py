"""Fundamental and essential matrices between matches with outliers: a batch of pairs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import cvkern
from profiling.arrays import to_host
from profiling.case import TOY, Case, Peer, Shape, Work

CAMERA = np.array([[800.0, 0, 500], [0, 800, 375], [0, 0, 1]])
INVERSE = np.linalg.inv(CAMERA)
WIDTH, HEIGHT = 1000, 750
MATCHES = 1000
HYPOTHESES = 2000  # the limit of the larger batch, of all contenders
THRESHOLD, NOISE = 1.0, 0.3  # pixels
LIMIT = 1.0  # pixels: the largest median distance from epipolar lines, of all pairs
HARD = 0.9  # share of the pairs for which that is asked where good samples are rare

Arrays = tuple[np.ndarray, ...]


def _project(points: np.ndarray) -> np.ndarray:
    q = points @ CAMERA.T
    return q[..., :2] / q[..., 2:]


def _inputs(pairs: int, outliers: float) -> Callable[[Shape, np.random.Generator], Arrays]:
    def make(shape: Shape, rng: np.random.Generator) -> Arrays:
        return _scenes(3, 200, 0.5, rng) if shape == TOY else _scenes(pairs, MATCHES, outliers, rng)

    return make


def _scenes(count: int, matches: int, outliers: float, rng: np.random.Generator) -> Arrays:
    """Points (P, N, 2) of both images as (row, column), and 50 exact pairs to judge by."""
    exact = 50
    depths = rng.uniform(3, 6, (count, matches + exact, 1))
    sides = rng.uniform((-0.6, -0.45), (0.6, 0.45), (count, matches + exact, 2))
    points = np.concatenate((sides * depths, depths), -1)
    turn = np.zeros((count, 3, 3))
    turn[:, (2, 0, 1), (1, 2, 0)] = rng.uniform(-0.05, 0.05, (count, 3))
    turn -= turn.swapaxes(1, 2)
    rotation = np.linalg.solve(np.eye(3) - turn, np.eye(3) + turn)  # Cayley's formula
    shift = rng.uniform((-0.6, -0.3, -0.3), (0.6, 0.3, 0.3), (count, 3))
    a = _project(points)
    b = _project(points @ rotation.swapaxes(1, 2) + shift[:, None])
    judged = np.concatenate((a, b), -1)[:, matches:]
    a, b = (p[:, :matches] + rng.normal(0, NOISE, (count, matches, 2)) for p in (a, b))
    wild = np.argsort(rng.random((count, matches)), 1) < round(outliers * matches)
    b[wild] = rng.uniform(0, (WIDTH, HEIGHT), (int(wild.sum()), 2))
    return np.ascontiguousarray(a[..., ::-1]), np.ascontiguousarray(b[..., ::-1]), judged


def _distances(matrices: Any, judged: Any) -> Arrays:
    """Median distances of exact points of the second image from their lines, (P,)."""
    found = []
    for f, points in zip(matrices, to_host(judged), strict=True):
        lines = np.c_[points[:, :2], np.ones(len(points))] @ np.asarray(f).T
        gaps = (np.c_[points[:, 2:], np.ones(len(points))] * lines).sum(axis=1)
        found.append(np.median(np.abs(gaps) / np.hypot(lines[:, 0], lines[:, 1])))
    return (np.array(found),)


def _batch(a: Any, b: Any, judged: Any) -> Arrays:
    fits = cvkern.find_fundamentals(list(zip(a, b, strict=True)), THRESHOLD)
    return _distances(fits.matrices, judged)


def _essentials(a: Any, b: Any, judged: Any) -> Arrays:
    fits = cvkern.find_essentials(list(zip(a, b, strict=True)), CAMERA, CAMERA, THRESHOLD)
    return _distances([INVERSE.T @ e @ INVERSE for e in fits.matrices], judged)


def _many_essentials(a: Any, b: Any, judged: Any) -> Arrays:
    pairs = list(zip(a, b, strict=True))
    fits = cvkern.find_essentials(pairs, CAMERA, CAMERA, THRESHOLD, max_trials=HYPOTHESES)
    return _distances([INVERSE.T @ e @ INVERSE for e in fits.matrices], judged)


def _peer(find: Any) -> Any:
    def call(module: Any, a: np.ndarray, b: np.ndarray, judged: np.ndarray) -> Arrays:
        x, y = (np.ascontiguousarray(p[..., ::-1]) for p in (a, b))
        return _distances([find(module, p, q) for p, q in zip(x, y, strict=True)], judged)

    return call


def _magsac(cv2: Any, a: np.ndarray, b: np.ndarray) -> Any:
    return cv2.findFundamentalMat(a, b, cv2.USAC_MAGSAC, THRESHOLD, 0.999, 10000)[0]


def _poselib(poselib: Any, a: np.ndarray, b: np.ndarray) -> Any:
    return poselib.estimate_fundamental(a, b, {"max_epipolar_error": THRESHOLD})[0]


def _degensac(pydegensac: Any, a: np.ndarray, b: np.ndarray) -> Any:
    return pydegensac.findFundamentalMatrix(a, b, THRESHOLD)[0]


def _magsac_essential(cv2: Any, a: np.ndarray, b: np.ndarray, *most: int) -> Any:
    found, _ = cv2.findEssentialMat(a, b, CAMERA, cv2.USAC_MAGSAC, 0.999, THRESHOLD, *most)
    return INVERSE.T @ found @ INVERSE


def _poselib_essential(poselib: Any, a: np.ndarray, b: np.ndarray, **limits: int) -> Any:
    camera = {"model": "PINHOLE", "width": WIDTH, "height": HEIGHT,
              "params": [CAMERA[0, 0], CAMERA[1, 1], CAMERA[0, 2], CAMERA[1, 2]]}  # fmt: skip
    options = {"max_epipolar_error": THRESHOLD, **limits}
    pose, _ = poselib.estimate_relative_pose(a, b, camera, camera, options)
    return INVERSE.T @ np.cross(np.eye(3), -pose.t) @ pose.R @ INVERSE


def _case(
    name: str,
    title: str,
    call: Any,
    peers: tuple[Peer, ...],
    pairs: int = 20,
    outliers: float = 0.5,
    share: float = 1.0,
) -> Case:
    return Case(
        name=name,
        title=title,
        image=_inputs(pairs, outliers),
        call=call,
        oracle=lambda a, b, judged: (np.zeros(len(a)),),
        oracle_name="exact points of the scenes",
        difference=lambda ours, right: float(np.quantile(np.abs(ours[0] - right[0]), share)),
        tolerance=LIMIT,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=peers,
        captures=False,
        work=Work("pairs", lambda a, b, judged: float(len(a))),
        sizes=("VGA",),  # points know no size
        most_inputs=2,
        margin=0,
    )


CASES = (
    _case(
        "fundamentals_50",
        "20 fundamental matrices, 1000 matches, 50 % outliers",
        _batch,
        (
            Peer("OpenCV, MAGSAC", "cv2", _peer(_magsac)),
            Peer("PoseLib", "poselib", _peer(_poselib)),
            Peer("pydegensac", "pydegensac", _peer(_degensac)),
        ),
    ),
    _case(
        "essentials_50",
        "20 essential matrices, 1000 matches, 50 % outliers",
        _essentials,
        (
            Peer("OpenCV, MAGSAC", "cv2", _peer(_magsac_essential)),
            Peer("PoseLib", "poselib", _peer(_poselib_essential)),
        ),
    ),
    _case(
        "essentials_75",
        "200 essential matrices, 1000 matches, 75 % outliers, at most 2000 hypotheses",
        _many_essentials,
        (
            Peer("OpenCV, MAGSAC", "cv2", _peer(lambda *x: _magsac_essential(*x, HYPOTHESES))),
            Peer(
                "PoseLib",
                "poselib",
                _peer(partial(_poselib_essential, max_iterations=HYPOTHESES)),
            ),
        ),
        200,
        0.75,
        HARD,
    ),
)
