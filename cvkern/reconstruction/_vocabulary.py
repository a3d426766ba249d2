"""Photographs that look alike, by the visual words that they share.

The vocabulary is made of the photographs: k-means clusters a sample of their descriptors.
A photograph is the list of its words, each weighted by how rare it is [Sivic and Zisserman 2003].
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features._photographs import as_host
from cvkern.features.matching import match_descriptors, match_images
from cvkern.reconstruction._photographs import Keypoints

MOST_WORDS = 4096
FOR_WORD = 16  # descriptors that a word is made of, on average
ROUNDS = 6  # steps of k-means


def learn_words(rt: Runtime, found: list[Keypoints]) -> Any:
    """Return visual words (W, 128) uint8, where kernels are."""
    sizes = np.array([len(k.place_of) for k in found])
    total = int(sizes.sum())
    count = max(1, min(MOST_WORDS, total // FOR_WORD))
    chosen = _spread(total, count * FOR_WORD)
    whole = np.concatenate(
        [np.zeros((0, 128), np.uint8)] + [as_host(rt, k.descriptors) for k in found]
    )
    sample = whole[chosen]
    words = sample[_spread(len(sample), count)]
    given = rt.give(sample)
    for _ in range(ROUNDS):
        labels = as_host(rt, match_descriptors(given, rt.give(words), cross_check=False))[:, 1]
        order = np.argsort(labels, kind="stable")
        _, first, counts = np.unique(labels[order], return_index=True, return_counts=True)
        sums = np.add.reduceat(sample[order].astype(np.int32), first, axis=0)
        # The mean, rounded half up: integers, so that every device finds the same words.
        words = ((2 * sums + counts[:, None]) // (2 * counts[:, None])).astype(np.uint8)
    return rt.give(words)


def _spread(total: int, count: int) -> np.ndarray:
    """Return at most `count` indices below `total`, at equal distances."""
    count = min(total, count)
    return np.arange(count) * total // max(1, count)


def likeness(rt: Runtime, found: list[Keypoints]) -> np.ndarray:
    """Return how alike photographs are, (N, N), 0 to 1: the cosines of their weighted words."""
    from scipy.sparse import coo_matrix

    count = len(found)
    if not any(len(k.place_of) for k in found):
        return np.zeros((count, count))
    words = learn_words(rt, found)
    pairs = np.array([(i, count) for i in range(count)])
    matches = match_images([*(k.descriptors for k in found), words], pairs, cross_check=False)
    own = [as_host(rt, m)[:, 1] for m in matches]
    view = np.repeat(np.arange(count), [len(w) for w in own])
    ones = np.ones(len(view))
    lists = coo_matrix((ones, (np.concatenate(own), view)), (words.shape[0], count)).tocsr()
    lists.sum_duplicates()
    # A word that repeats in a photograph (a window of a facade) counts by its square root.
    lists.data = np.sqrt(lists.data)
    rare = np.log(count / np.maximum(np.diff(lists.indptr), 1))
    lists.data *= np.repeat(rare, np.diff(lists.indptr))
    lengths = np.sqrt(np.asarray(lists.multiply(lists).sum(axis=0)).ravel())
    lists = lists.multiply(1 / np.maximum(lengths, 1e-12)[None, :]).tocsc()
    return np.asarray((lists.T @ lists).todense())


def nearest_pairs(alike: np.ndarray, neighbors: int) -> np.ndarray:
    """Return pairs (P, 2), i < j, in which one is among the nearest of the other."""
    count = len(alike)
    alike = np.where(np.eye(count, dtype=bool), -1.0, alike)
    nearest = np.argsort(-alike, axis=1, kind="stable")[:, :neighbors]
    likely = np.zeros((count, count), bool)
    likely[np.arange(count)[:, None], nearest] = True
    likely = (likely | likely.T) & (alike > 0)
    return np.argwhere(np.triu(likely, 1))
