"""Which photographs are compared: visual words, sequences, and given pairs."""

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.reconstruction import _pairs, _vocabulary
from cvkern.reconstruction._photographs import Keypoints

SIDE = 24  # descriptors of a photograph


def described(descriptors):
    count = len(descriptors)
    at = np.zeros((count, 2))
    return Keypoints(at, np.arange(count), descriptors, at[:, 0], np.zeros((count, 3), np.uint8))


@pytest.fixture
def places():
    """Return 12 photographs of three places: and a few descriptors of nothing else."""
    rng = np.random.default_rng(0)
    of_place = rng.integers(0, 120, (3, SIDE, 128))
    found = []
    for n in range(12):
        own = of_place[n % 3] + rng.integers(-4, 5, (SIDE, 128))
        strange = rng.integers(0, 120, (SIDE // 4, 128))
        found.append(described(np.concatenate((own, strange)).clip(0, 255).astype(np.uint8)))
    return found


@pytest.mark.usefixtures("backend")
def test_photographs_of_a_place_share_words(places):
    rt = runtime(places[0].descriptors)
    alike = _vocabulary.likeness(rt, places)
    np.testing.assert_allclose(np.diag(alike), 1)
    np.testing.assert_allclose(alike, alike.T, atol=1e-12)
    same = np.subtract.outer(np.arange(12), np.arange(12)) % 3 == 0
    off = ~np.eye(12, dtype=bool)
    assert alike[same & off].min() > alike[~same].max()
    pairs = _pairs.choose_pairs(rt, places, "vocabulary", 3)
    assert [tuple(p) for p in pairs] == [(i, j) for i in range(12) for j in range(i + 3, 12, 3)]


def test_likeness_is_that_of_numpy(places):
    """The cosines of words that weigh sqrt(n) log(N / N_word)."""
    places[0] = described(np.concatenate([places[0].descriptors] * 3))  # repeated things
    rt = runtime(places[0].descriptors)
    words = np.asarray(_vocabulary.learn_words(rt, places)).astype(int)
    numbers = np.array([
        np.bincount(((k.descriptors[:, None] - words) ** 2).sum(axis=2).argmin(axis=1),
                    minlength=len(words)) for k in places
    ])  # fmt: skip
    weighed = np.sqrt(numbers) * np.log(len(places) / np.maximum((numbers > 0).sum(axis=0), 1))
    weighed /= np.linalg.norm(weighed, axis=1)[:, None]
    np.testing.assert_allclose(_vocabulary.likeness(rt, places), weighed @ weighed.T, atol=1e-9)


def test_words_are_those_of_numpy(places):
    """K-means by broadcasting: the nearest word, the first of equals; means rounded half up."""
    words = np.asarray(_vocabulary.learn_words(runtime(places[0].descriptors), places))
    whole = np.concatenate([k.descriptors for k in places]).astype(int)
    assert len(whole) == 360
    whole = whole[np.arange(352) * 360 // 352]
    expected = whole[np.arange(22) * 352 // 22]
    for _ in range(_vocabulary.ROUNDS):
        near = ((whole[:, None] - expected) ** 2).sum(axis=2).argmin(axis=1)
        means = [whole[near == n].mean(axis=0) for n in np.unique(near)]
        expected = np.floor(np.array(means) + 0.5).astype(int)
    np.testing.assert_array_equal(words, expected)


def test_sequences_all_and_given(places):
    rt = runtime(places[0].descriptors)

    def chosen(pairs, neighbors=2):
        return [tuple(p) for p in _pairs.choose_pairs(rt, places[:4], pairs, neighbors).tolist()]

    assert chosen("sequence") == [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)]
    assert (
        chosen("all")
        == chosen("auto")
        == [*chosen("sequence")[:2], (0, 3), *chosen("sequence")[2:]]
    )
    assert chosen(np.array([[1, 3]])) == [(1, 3)]
    nothing = [described(np.zeros((0, 128), np.uint8))] * 2
    assert len(_pairs.choose_pairs(rt, nothing, "vocabulary", 2)) == 0
    images = [np.zeros((20, 30), np.uint8)] * 3
    assert len(cvkern.reconstruct(images, pairs=np.zeros((0, 2), int)).placed) == 0
