"""Matching of descriptors between two images, or between all pairs of a set of images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_array, as_items, check_choice, check_flag, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.features import BLOCK_ROWS, MOST_BYTES

METRICS = ("euclidean", "hamming")
MAX_ROWS = 2**24
PART = 8  # descriptors are padded with zeros to a multiple of so many bytes


def match_descriptors(
    a: Any,
    b: Any,
    max_ratio: float = 1.0,
    cross_check: bool = True,
    *,
    metric: str = "euclidean",
) -> Any:
    """Match the descriptors of two images.

    Parameters
    ----------
    a : array of shape (N, D), uint8
        Descriptors, of at most 4096 bytes each.
    b : array of shape (M, D), uint8
        Descriptors of the other image.
    max_ratio : float, default 1.0
        Keep a match only if its distance is less than this times the distance of the second
        nearest. At 1 all matches are kept, including ties.
    cross_check : bool, default True
        Keep a match only if each descriptor is the nearest one of the other.
    metric : {'euclidean', 'hamming'}, default 'euclidean'
        'hamming': the number of bits that differ, for binary descriptors.

    Returns
    -------
    array of shape (K, 2), int32
        Indices into `a` and `b`, ascending in `a`. Among equal distances the smallest index wins.

    Raises
    ------
    TypeError
        If the descriptors are not uint8, or are Features, which have them as a field.
    ValueError
        If the shapes do not agree, `max_ratio` is not in (0, 1], or `metric` is unknown.

    Notes
    -----
    Distances are exact integers, so that every device finds the same matches. The ratio is between
    distances, not their squares, as in :func:`skimage.feature.match_descriptors`.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> a = np.array([[0, 0], [9, 9], [50, 0]], np.uint8)
    >>> b = np.array([[10, 9], [1, 0]], np.uint8)
    >>> cvkern.match_descriptors(a, b)
    array([[0, 1],
           [1, 0]], dtype=int32)
    """
    cross_check = check_flag(cross_check, "cross_check")
    for given, name in ((a, "a"), (b, "b")):
        if hasattr(given, "descriptors"):
            raise TypeError(f"{name} must be descriptors, got Features: take its descriptors")
    rt, arrays = _check([a, b], max_ratio, metric, ("a", "b"))
    pairs = np.array([[0, 1]])
    return _matches(rt, arrays, pairs, max_ratio, cross_check, metric)[0]


def match_images(
    features: Sequence[Any],
    pairs: Any = None,
    *,
    max_ratio: float = 1.0,
    cross_check: bool = True,
    metric: str = "euclidean",
) -> list[Any]:
    """Match the descriptors of every pair of a set of images, in one launch.

    Parameters
    ----------
    features : sequence of Features, or of arrays of shape (N, D), uint8
        Features or descriptors of each image; N may differ and may be 0.
    pairs : array of shape (P, 2), optional
        Indices of the images to match; by default all pairs i < j, in the order (0, 1), (0, 2),
        ..., (1, 2), ...
    max_ratio, cross_check, metric
        As in :func:`match_descriptors`.

    Returns
    -------
    list of arrays of shape (K, 2), int32
        The matches of each pair, as :func:`match_descriptors` returns them.

    Raises
    ------
    TypeError
        If the descriptors are not uint8.
    ValueError
        If the shapes do not agree, `pairs` are not indices of two different images, `max_ratio`
        is not in (0, 1], or `metric` is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> heap = [np.array(d, np.uint8) for d in ([[0, 0]], [[1, 0], [9, 9]], [[9, 8]])]
    >>> [found.tolist() for found in cvkern.match_images(heap)]
    [[[0, 0]], [[0, 0]], [[1, 0]]]
    """
    cross_check = check_flag(cross_check, "cross_check")
    features = as_items(features, "features", "a sequence of features or descriptors")
    descriptors = [getattr(f, "descriptors", f) for f in features]
    names = tuple(f"features[{i}]" for i in range(len(descriptors)))
    rt, arrays = _check(descriptors, max_ratio, metric, names)
    count = len(arrays)
    if pairs is None:
        table = np.stack(np.triu_indices(count, 1), axis=1)
    else:
        table = np.asarray(as_array(pairs, "pairs"))
        if table.size and table.dtype.kind not in "iu":
            raise TypeError(f"pairs must be integers, got {table.dtype}")
        if table.size and (table.ndim != 2 or table.shape[1] != 2):
            raise ValueError(f"pairs must have shape (N, 2), got {table.shape}")
        table = table.reshape(-1, 2)
        if table.size and (
            table.min() < 0 or table.max() >= count or (table[:, 0] == table[:, 1]).any()
        ):
            raise ValueError(f"pairs must be two different images of {count}, got others")
        table = table.astype(np.int64)
    return _matches(rt, arrays, table, max_ratio, cross_check, metric)


def _check(
    descriptors: Sequence[Any], max_ratio: float, metric: str, names: Sequence[str]
) -> tuple[Runtime, list[Any]]:
    check_choice(metric, METRICS, "metric")
    ratio = check_number(max_ratio, "max_ratio")
    if not 0 < ratio <= 1:
        raise ValueError(f"max_ratio must be in (0, 1], got {ratio:g}")
    arrays = [as_array(d, name) for d, name in zip(descriptors, names, strict=True)]
    for array, name in zip(arrays, names, strict=True):
        if len(array.shape) != 2:
            raise ValueError(f"{name} must be 2-D, got shape {tuple(array.shape)}")
        dtype = library(array).dtype(array)
        if dtype != np.uint8:
            raise TypeError(f"{name} must be uint8, got {dtype}")
        if array.shape[1] != arrays[0].shape[1]:
            raise ValueError(
                f"{name} must have {arrays[0].shape[1]} bytes a row, got {array.shape[1]}"
            )
        check_integer(array.shape[1], f"the bytes of {name}", 1, MOST_BYTES)
    check_integer(sum(a.shape[0] for a in arrays), "the number of descriptors", 0, MAX_ROWS)
    return runtime(*arrays), arrays


def _matches(
    rt: Runtime,
    arrays: Sequence[Any],
    pairs: np.ndarray,
    max_ratio: float,
    cross_check: bool,
    metric: str,
) -> list[Any]:
    """Return the matches of each pair."""
    sizes = np.array([a.shape[0] for a in arrays], np.int64)
    jobs, job_of = np.unique(
        np.r_[pairs, pairs[:, ::-1]] if cross_check else pairs, axis=0, return_inverse=True
    )
    rows = np.where(sizes[jobs[:, 1]] > 0, sizes[jobs[:, 0]], 0)
    places = _before(rows)
    forward = job_of.reshape(-1)[: len(pairs)]
    backward = places[job_of.reshape(-1)[len(pairs) :]] if cross_check else -1
    count, most = int(rows[forward].sum()), int(rows.max(initial=0))
    if not count:
        return [rt.release(rt.empty((0, 2), np.int32)) for _ in pairs]

    best, second, index = (
        rt.scratch(f"matching.{name}", (int(rows.sum()),), np.int32)
        for name in ("best", "second", "index")
    )
    blocks = rt.send("matching.blocks", _blocks(jobs, rows, places, sizes))
    kernels = rt.features.matching
    binary = int(metric == "hamming")
    kernels.find_nearest(_together(rt, arrays), blocks, binary, best, second, index)

    # d1 < r d2 for distances is d1^2 < r^2 d2^2; Hamming's are not squared.
    factor = max_ratio if metric == "hamming" else max_ratio * max_ratio
    table = np.empty((len(pairs), 4), np.int32)
    table[:, 0], table[:, 1] = rows[forward], places[forward]
    table[:, 2], table[:, 3] = backward, _before(rows[forward])
    sent = rt.send("matching.pairs", table)
    counts = rt.scratch("matching.counts", (count,), np.int32)
    ends = rt.scratch("matching.ends", (len(pairs),), np.int32)
    kernels.keep_matches(sent, most, factor, best, second, index, counts, ends)
    last = rt.to_numpy(ends).tolist()
    found = rt.empty((last[-1], 2), np.int32)
    if last[-1]:
        kernels.write_matches(sent, most, index, counts, rt.adopt(found, np.int32))
    found = rt.release(found)
    return [found[begin:end] for begin, end in zip([0, *last], last, strict=False)]


def _before(sizes: np.ndarray) -> np.ndarray:
    """Return the sum of the sizes before each."""
    return np.cumsum(sizes) - sizes


def _blocks(
    jobs: np.ndarray, rows: np.ndarray, places: np.ndarray, sizes: np.ndarray
) -> np.ndarray:
    """Cut the rows of each job, an image against another, into blocks: see `find_nearest`."""
    counts = -(-rows // BLOCK_ROWS)
    job = np.repeat(np.arange(len(jobs)), counts)
    row = BLOCK_ROWS * (np.arange(len(job)) - np.repeat(_before(counts), counts))
    (own, other), starts = jobs[job].T, _before(sizes)
    end = np.minimum(row + BLOCK_ROWS, rows[job])
    columns = (
        starts[own] + row, starts[own] + end, starts[other], starts[other] + sizes[other],
        places[job] + row,
    )  # fmt: skip
    return np.stack(columns, axis=1).astype(np.int32)


def _together(rt: Runtime, arrays: Sequence[Any]) -> Any:
    """Return all descriptors in one kernel array, padded to whole words."""
    wide = -(-arrays[0].shape[1] // PART) * PART
    whole = rt.scratch("matching.rows", (sum(a.shape[0] for a in arrays), wide), np.uint8)
    first = 0
    for array in arrays:
        if array.shape[0]:
            rt.features.matching.pack_descriptors(rt.adopt(array, np.uint8), first, whole)
        first += array.shape[0]
    return whole
