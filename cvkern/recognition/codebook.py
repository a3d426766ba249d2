"""Codebooks: visual words, each the mean of patches that look alike."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_image, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern._whites import white_of
from cvkern.kernels.codes.recognition import LARGEST, NOBODY
from cvkern.recognition.patches import LEAST_SIDE, MOST_SIDE, Sampling, cut

METHODS = ("auto", "agglomerative", "kmeans")
MOST_PATCHES = 2**22
MOST_CLUSTERED = 2**15  # patches that `agglomerative` takes: products of their sums fit 64 bits
MOST_AUTO = 2000  # patches up to which `auto` means `agglomerative`
MOST_CODEBOOK = 2**16  # words
ROUNDS = 12  # steps of k-means


class Codebook(NamedTuple):
    """Visual words, and the patches that each stands for."""

    words: Any
    """Normalised patches: mean 0, standard deviation 32, (K, S, S) int8."""
    labels: Any
    """The word of each patch, or -1 for a patch that is flat, (N,) int32."""


def learn_codebook(
    patches: Any,
    words: int | None = None,
    *,
    method: str = "auto",
    threshold: float = 0.7,
    data_range: float | None = None,
) -> Codebook:
    """Cluster patches to visual words.

    Parameters
    ----------
    patches : array of shape (N, S, S)
        Patches of S x S pixels, 8 <= S <= 25; any real dtype. Those with a standard deviation below
        1.5 % of white are flat, and ignored.
    words : int, optional
        Number of words that `kmeans` begins with; some may become empty, and are removed. By
        default a tenth of the patches.
    method : {'auto', 'agglomerative', 'kmeans'}
        `agglomerative` merges reciprocal nearest neighbours until the mean correlation between the
        patches of any two clusters is below `threshold` (average linkage). It takes at most 32768
        patches, and memory for the products of all pairs. `kmeans` begins with `words` patches at
        equal distances in the list. `auto` is `agglomerative` if `words` is not given and there are
        at most 2000 patches.
    threshold : float, default 0.7
        Least mean correlation within a cluster of `agglomerative`, in (0, 1].
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.

    Returns
    -------
    Codebook
        Named tuple of `words` (K, S, S) int8 and `labels` (N,) int32. Words are in the order of
        their first patches.

    Raises
    ------
    TypeError
        If `patches` does not hold real numbers, or an option is of a wrong type.
    ValueError
        If `patches` has a wrong shape or no patch that is not flat, or an option is out of range.

    Notes
    -----
    Patches are normalised and rounded to integers. All similarities are exact products of integers,
    so that every device finds the same words.

    References
    ----------
    .. [1] B. Leibe, A. Leonardis and B. Schiele, "Robust object detection with interleaved
       categorization and segmentation", IJCV 77, 2008.
    .. [2] C. de Rham, Les Cahiers de l'Analyse des Donnees 5(2), 1980: reciprocal neighbours.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> stripes = np.tile([0.0, 1.0], (8, 4))
    >>> found = cvkern.learn_codebook([stripes, stripes.T, 0.5 * stripes])
    >>> found.words.shape, found.labels
    ((2, 8, 8), array([0, 1, 0], dtype=int32))
    """
    check_choice(method, METHODS, "method")
    limit = check_number(threshold, "threshold")
    if not 0 < limit <= 1:
        raise ValueError(f"threshold must be in (0, 1], got {limit:g}")
    patches = check_image(patches, ndim=(3,), name="patches")
    count, side, wide = patches.shape
    check_integer(count, "the number of patches", 1, MOST_PATCHES)
    if side != wide or not LEAST_SIDE <= side <= MOST_SIDE:
        rule = f"(N, S, S) with S in [{LEAST_SIDE}, {MOST_SIDE}]"
        raise ValueError(f"patches must have shape {rule}, got {tuple(patches.shape)}")
    if words is not None:
        words = check_integer(words, "words", 1, MOST_CODEBOOK)
    white = white_of(patches, data_range)
    sampling = Sampling(side, "grid", side)
    rt = runtime(patches)
    flat = rt.adopt(patches, shape=(count * side, side))
    gray = rt.scratch("recognition.pyramid", (count * side, side))
    rt.features.keypoints.extrema.prepare(
        flat.reshape((count * side, side, 1)), float(np.float32(1 / white)), gray
    )
    corners = np.column_stack([side * side * np.arange(count), np.full(count, side)])
    sent = rt.send("recognition.corners", corners.astype(np.int32))
    normal = cut(rt, gray.reshape((count * side * side,)), sent, sampling)
    values = np.array(rt.to_numpy(normal))
    there = np.flatnonzero(values.any(axis=1))
    if not len(there):
        raise ValueError("patches must have one that is not flat, got none")
    if method == "auto":
        few = words is None and len(there) <= MOST_AUTO
        method = "agglomerative" if few else "kmeans"
    found, of = cluster(rt, values[there], words, method, limit, sampling)
    labels = np.full(count, NOBODY, np.int32)
    labels[there] = of
    shaped = np.ascontiguousarray(found[:, : side * side].reshape(-1, side, side))
    return Codebook(rt.give(shaped), rt.give(labels))


def cluster(
    rt: Runtime,
    patches: np.ndarray,
    words: int | None,
    method: str,
    threshold: float,
    sampling: Sampling,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the words (K, D) int8 of normalised patches (N, D), and the word of each patch."""
    if method == "agglomerative":
        check_integer(len(patches), "the number of patches to agglomerate", 1, MOST_CLUSTERED)
        labels = _agglomerate(rt, patches, math.ceil(threshold * sampling.norm))
    else:
        labels = _k_means(rt, patches, words or max(len(patches) // 10, 1), sampling)
    labels = _in_order(labels)
    return _means(patches, labels, sampling), labels


def _in_order(labels: np.ndarray) -> np.ndarray:
    """Return labels that number the clusters in the order of their first patches."""
    _, first, of = np.unique(labels, return_index=True, return_inverse=True)
    order = np.empty(len(first), np.int32)
    order[np.argsort(first)] = np.arange(len(first))
    return order[of.reshape(-1)]


def _means(patches: np.ndarray, labels: np.ndarray, sampling: Sampling) -> np.ndarray:
    """Return the mean of the patches of each label, at the length of a patch."""
    order = np.argsort(labels, kind="stable")
    _, first = np.unique(labels[order], return_index=True)
    sums = np.add.reduceat(patches[order].astype(np.int32), first, axis=0).astype(np.int64)
    length = np.sqrt((sums * sums).sum(axis=1).astype(np.float64)).clip(1)
    scaled = sums * (math.sqrt(sampling.norm) / length)[:, None]
    return np.rint(scaled).clip(-LARGEST, LARGEST).astype(np.int8)


def _k_means(rt: Runtime, patches: np.ndarray, words: int, sampling: Sampling) -> np.ndarray:
    """Assign patches to the mean with the largest product, until none changes or `ROUNDS` times."""
    count = len(patches)
    means = patches[np.arange(min(words, count)) * count // min(words, count)]
    sent = rt.send("recognition.clustered", patches)
    products, nearest = (
        rt.scratch(f"recognition.{name}", (count, 1), np.int32) for name in ("products", "matches")
    )
    labels = np.full(count, NOBODY, np.int32)
    for _ in range(ROUNDS):
        given = rt.send("recognition.means", np.ascontiguousarray(means))
        rt.recognition.codebook.match_words(sent, given, -(2**30), products, nearest)
        found = np.array(rt.to_numpy(nearest)[:, 0])
        if (found == labels).all():
            break
        labels = found
        means = _means(patches, labels, sampling)
        labels = np.unique(labels, return_inverse=True)[1].reshape(-1).astype(np.int32)
    return labels


def _agglomerate(rt: Runtime, patches: np.ndarray, least: int) -> np.ndarray:
    """Merge all pairs of reciprocal nearest neighbours, again and again.

    With average linkage no merger brings another cluster nearer than its two parts were, so that
    mergers of pairs commute, and only neighbours of merged clusters must look again.
    """
    kernels, count = rt.recognition.codebook, len(patches)
    sums = rt.scratch("recognition.gram", (count, count), np.int64)
    kernels.multiply_pairs(rt.send("recognition.clustered", patches), sums)
    sizes = rt.scratch("recognition.sizes", (count,), np.int32)
    rt.write(sizes, np.ones(count, np.int32))
    partners = rt.scratch("recognition.partners", (count,), np.int32)
    labels, index = np.arange(count), np.arange(count)
    stale = np.ones(count, np.int32)
    # A round merges a pair, or asks all clusters for fresh partners. Then the first cluster that
    # reaches the largest similarity of all and its partner choose each other. So every second round
    # merges a pair at least, and there are fewer than 2 `count` rounds.
    while True:
        kernels.find_partners(sums, sizes, least, rt.send("recognition.stale", stale), partners)
        found = np.array(rt.to_numpy(partners))
        alive = np.bincount(labels, minlength=count) > 0
        found[~alive] = NOBODY
        first = index[(found > index) & (found[found] == index)]
        if not len(first):
            if (found == NOBODY).all():
                return labels
            stale[:] = 1  # ties led partners round in a ring; of fresh ones a pair is reciprocal
            continue
        second = found[first]
        pairs = np.column_stack([first, second]).astype(np.int32)
        kernels.merge_clusters(rt.send("recognition.pairs", pairs), sums, sizes)
        into = index.copy()
        into[second] = first
        labels = into[labels]
        merged = np.zeros(count, bool)
        merged[first] = merged[second] = True
        stale = (merged | merged[found.clip(0)] & (found >= 0)).astype(np.int32)
