"""Matching against all distances by NumPy, and against OpenCV."""

import cv2
import numpy as np
import pytest

import cvkern
from cvkern.features import Features


def distances(a, b, metric):
    if metric == "hamming":
        return np.unpackbits(a[:, None] ^ b[None], axis=2).sum(axis=2).astype(np.int64)
    return ((a[:, None].astype(np.int64) - b[None]) ** 2).sum(axis=2)


def matches(a, b, ratio, cross, metric):
    """State the matches; argmin takes the first of equals."""
    if not len(a) or not len(b):
        return np.empty((0, 2), int)
    d = distances(a, b, metric)
    own, nearest = np.arange(len(a)), d.argmin(axis=1)
    kept = np.ones(len(a), bool)
    if cross:
        kept &= d.argmin(axis=0)[nearest] == own
    if ratio < 1 and len(b) > 1:
        first, second = np.sort(d, axis=1)[:, :2].T
        kept &= first < (ratio if metric == "hamming" else ratio * ratio) * second
    return np.stack((own[kept], nearest[kept]), axis=1)


def made(count, size, seed):
    """Return descriptors with repetitions, near ones, and the ends of the range."""
    rng = np.random.default_rng(seed)
    found = np.random.default_rng(7).integers(0, 256, (count, size))
    found = (found + rng.integers(-20, 21, found.shape)).clip(0, 255).astype(np.uint8)
    if count > 4:
        found[::4], found[1], found[-1] = found[0], 255, 0
    return found


SIZES = [(1, 1, 128), (1, 9, 128), (9, 1, 8), (64, 65, 128), (131, 203, 32), (17, 16, 5)]


@pytest.mark.parametrize("metric", ["euclidean", "hamming"])
@pytest.mark.parametrize(
    ("ratio", "cross"), [(1.0, True), (1.0, False), (0.8, True), (0.95, False)]
)
@pytest.mark.parametrize(("n", "m", "size"), SIZES)
def test_all_distances(backend, n, m, size, ratio, cross, metric):
    a, b = made(n, size, 1), made(m, size, 2)
    got = cvkern.match_descriptors(a, b, ratio, cross, metric=metric)
    assert got.dtype == np.int32
    np.testing.assert_array_equal(got, matches(a, b, ratio, cross, metric))


def test_matches_are_opencvs(backend):
    rng = np.random.default_rng(3)
    a, b = (rng.integers(0, 256, (300, 128)).astype(np.uint8) for _ in range(2))
    found = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(
        *(x.astype(np.float32) for x in (a, b))
    )
    want = np.array([(m.queryIdx, m.trainIdx) for m in found])
    np.testing.assert_array_equal(cvkern.match_descriptors(a, b), want)


def test_long_descriptors_of_the_largest_distance(backend):
    a, b = np.zeros((3, 4096), np.uint8), np.full((2, 4096), 255, np.uint8)
    b[1, 0] = 254
    assert cvkern.match_descriptors(a, b, cross_check=False).tolist() == [[0, 1], [1, 1], [2, 1]]


def test_images(backend):
    heap = [made(count, 128, seed) for seed, count in enumerate((40, 0, 130, 65, 1))]
    found = cvkern.match_images(heap, max_ratio=0.9)
    places = [(i, j) for i in range(5) for j in range(i + 1, 5)]
    assert len(found) == len(places)
    for got, (i, j) in zip(found, places, strict=True):
        np.testing.assert_array_equal(got, matches(heap[i], heap[j], 0.9, True, "euclidean"))
    chosen = cvkern.match_images(heap, [(3, 0), (0, 3), (3, 0)], max_ratio=0.9)
    np.testing.assert_array_equal(chosen[1], found[2])
    np.testing.assert_array_equal(chosen[0], chosen[2])
    np.testing.assert_array_equal(chosen[0], matches(heap[3], heap[0], 0.9, True, "euclidean"))
    wrapped = [Features(None, None, None, None, d) for d in heap]
    for a, b in zip(cvkern.match_images(wrapped, max_ratio=0.9), found, strict=True):
        np.testing.assert_array_equal(a, b)
    assert cvkern.match_images(heap[:1]) == []
    assert cvkern.match_images([]) == []


@pytest.mark.parametrize(("metric", "kept"), [("euclidean", (0.84, 0.83)), ("hamming", (0.7, 0.6))])
def test_the_ratio_is_of_distances(backend, metric, kept):
    """10 and 12 from zero: a ratio of 0.833. Two bits and three: of 0.667."""
    a, b = np.zeros((1, 32), np.uint8), np.zeros((2, 32), np.uint8)
    b[:, 0] = (10, 12) if metric == "euclidean" else (3, 7)
    found = [len(cvkern.match_descriptors(a, b, ratio, metric=metric)) for ratio in kept]
    assert found == [1, 0]


def test_many_sizes(backend):
    """Kernels are launched with more sizes than launches are kept for, and again with the first."""
    other = made(40, 128, 1)
    for count in [*range(5, 40), 5, 38]:
        one = made(count, 128, 0)
        found = cvkern.match_descriptors(one, other)
        np.testing.assert_array_equal(found, matches(one, other, 1, True, "euclidean"))
