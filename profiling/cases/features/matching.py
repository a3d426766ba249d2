"""Matching of descriptors."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, Work, unequal

COUNT = 2000


def _descriptors(size: int) -> Any:
    def make(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Half of the second are the first, a little changed."""
        count = min(COUNT, shape[0] * shape[1] // 16)
        one, other = (rng.integers(0, 128, (count, size)).astype(np.uint8) for _ in range(2))
        half = rng.permutation(count)[: count // 2]
        other[: len(half)] = one[half] ^ rng.integers(0, 4, (len(half), size)).astype(np.uint8)
        return one, other

    return make


def _all_distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    a, b = one.astype(np.float64), other.astype(np.float64)
    d = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2 * a @ b.T
    return _mutual(d)


def _all_bits(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    a, b = (np.unpackbits(x, axis=1).astype(np.float64) for x in (one, other))
    return _mutual(a.sum(1)[:, None] + b.sum(1) - 2 * a @ b.T)


def _mutual(d: np.ndarray) -> np.ndarray:
    nearest = d.argmin(axis=1)
    own = np.arange(len(d))
    kept = d.argmin(axis=0)[nearest] == own
    return np.stack((own[kept], nearest[kept]), axis=1)


def _of_opencv(norm: str, dtype: Any) -> Any:
    def call(cv2: Any, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        matcher = cv2.BFMatcher(getattr(cv2, norm), crossCheck=True)
        found = matcher.match(one.astype(dtype, copy=False), other.astype(dtype, copy=False))
        return np.array([(m.queryIdx, m.trainIdx) for m in found])

    return call


CASES = tuple(
    Case(
        name=f"match_{metric}",
        title=title,
        image=_descriptors(size),
        call=lambda a, b, m=metric: cvkern.match_descriptors(a, b, metric=m),
        oracle=oracle,
        oracle_name="all distances by NumPy",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=0,
        operations_per_pixel=0,
        captures=False,
        peers=(Peer("OpenCV", "cv2", _of_opencv(norm, dtype)),),
        work=Work("distances", lambda a, b: float(len(a)) * len(b)),
        sizes=("1080p",),
        margin=0,
    )
    for metric, title, size, oracle, norm, dtype in (
        ("euclidean", "Mutual matches of 2000 x 2000, 128 bytes", 128, _all_distances, "NORM_L2",
         np.float32),
        ("hamming", "Mutual matches of 2000 x 2000, 256 bits", 32, _all_bits, "NORM_HAMMING",
         np.uint8),
    )
)  # fmt: skip
