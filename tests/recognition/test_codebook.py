"""Codebooks are those of SciPy's average linkage, and of k-means in NumPy."""

import numpy as np
import pytest
import scipy.cluster.hierarchy as hierarchy
import scipy.spatial.distance as distance

import cvkern
from tests.recognition.reference_recognition import normalised


def patches(count=60, kinds=6, side=10, seed=0):
    """Return noisy patches of some kinds, one of them flat."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(0, kinds, count)
    values = rng.random((kinds, side, side))[kind] + rng.normal(0, 0.15, (count, side, side))
    values[7] = 0.5
    return values.clip(0, 1).astype(np.float32), kind


def normal(values):
    count, side, _ = values.shape
    corners = [(side * i, 0) for i in range(count)]
    least = int(side * side * 0.015 * 4095)
    return normalised(values.reshape(-1, side), corners, side, least).astype(np.int64)


def same_partition(a, b):
    return len(set(zip(a.tolist(), b.tolist(), strict=True))) == len(set(a)) == len(set(b))


@pytest.mark.parametrize("threshold", [0.2, 0.5, 0.8])
def test_agglomerative(backend, threshold):
    values, _ = patches()
    words, labels = cvkern.learn_codebook(values, threshold=threshold)
    assert labels[7] == -1
    there = labels >= 0
    assert there.sum() == 59
    rows = normal(values)[there]
    norm = 32 * 32 * 100
    apart = norm - rows @ rows.T  # average linkage of distances is that of products
    linkage = hierarchy.average(distance.squareform(apart, checks=False))
    want = hierarchy.fcluster(linkage, norm - np.ceil(threshold * norm), "distance")
    assert same_partition(labels[there], want)
    assert len(words) == labels.max() + 1 == len(set(want))
    first = [np.flatnonzero(labels == k)[0] for k in range(len(words))]
    assert first == sorted(first)
    for k, word in enumerate(words):
        mean = rows[labels[there] == k].sum(axis=0)
        np.testing.assert_array_equal(
            word.ravel(), np.rint(mean * (320 / np.sqrt((mean * mean).sum()))).clip(-127, 127)
        )


def test_merges_of_many_at_once(backend):
    """Ties by the hundred: copies of few patches."""
    values, _ = patches(20, 20)
    copies = np.tile(values, (8, 1, 1))
    _, labels = cvkern.learn_codebook(copies, threshold=0.99)
    assert labels.max() == 18
    np.testing.assert_array_equal(labels, np.tile(labels[:20], 8))


def test_k_means(backend):
    values, _ = patches(80, 9)
    words, labels = cvkern.learn_codebook(values, 7)
    rows = normal(values)
    kept = rows[rows.any(axis=1)]
    means = kept[np.arange(7) * len(kept) // 7]
    of = np.zeros(len(kept), int)
    for _ in range(12):
        of = (kept @ means.T).argmax(axis=1)
        sums = np.array([kept[of == k].sum(axis=0) for k in range(7) if (of == k).any()])
        length = np.sqrt((sums * sums).sum(axis=1).astype(float))
        means = np.rint(sums * (320 / length)[:, None]).clip(-127, 127).astype(np.int64)
    assert same_partition(labels[labels >= 0], of)
    assert sorted(words.reshape(len(words), -1).tolist()) == sorted(means.tolist())


def test_kinds_are_found(backend):
    values, kind = patches(90, 5, 16)
    _, labels = cvkern.learn_codebook(values, threshold=0.5)
    there = labels >= 0
    assert same_partition(labels[there], kind[there])


def test_of_bytes_and_of_parts_of_white(backend):
    values, _ = patches()
    byte = np.rint(255 * values).astype(np.uint8)
    for other in (byte / 255.0, (byte / 255.0).astype(np.float32)):
        for a, b in zip(
            cvkern.learn_codebook(byte, 5), cvkern.learn_codebook(other, 5), strict=True
        ):
            np.testing.assert_array_equal(a, b)
