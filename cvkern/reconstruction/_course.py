"""The course of a reconstruction: its stages, each of which a journal keeps once it is finished."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features._photographs import as_host
from cvkern.panorama.registration import Heap
from cvkern.reconstruction._growth import ROUNDS, Growth
from cvkern.reconstruction._pairs import (
    Matched,
    Pair,
    agreeing,
    choose_pairs,
    consistent,
    match,
    verify,
    with_focals,
)
from cvkern.reconstruction._photographs import Keypoints, Lenses, Say, find_keypoints
from cvkern.reconstruction._tracks import find_tracks
from cvkern.scale.journals import Journal

TOGETHER = 512  # pairs that are matched in one go, and kept in one file
TRIAL = 8  # photographs by which focal lengths are compared
WORST = 4.0  # pixels
SAVE_EVERY = 1.0  # seconds between files of a model that grows


class Options(NamedTuple):
    """What a reconstruction does."""

    most: int
    """Keypoints of a photograph."""
    pairs: str | np.ndarray
    neighbors: int
    every: bool
    """Whether all models are wanted, not only the largest."""
    seed: int


class Course(NamedTuple):
    """What all stages share."""

    rt: Runtime
    options: Options
    book: Journal
    say: Say


def find_models(course: Course, heap: Heap, lenses: Lenses) -> list[Growth]:
    """Return the models of the photographs, the largest first; none if no pair has a baseline."""
    found = _keypoints(course, heap)
    matched = _matches(course, found)
    begun = _begun(course, found, matched, lenses)
    if begun is None:
        return []
    models = [begun]
    _grow(course, begun, 0)
    # A model places two photographs at least that were left.
    while True:
        left = ~np.any([m.placed for m in models], axis=0)
        largest = max(int(m.placed.sum()) for m in models)
        if not course.options.every and left.sum() <= largest:
            break
        pairs = [p for p in begun.pairs if left[p.first] and left[p.second]]
        lens = begun.lenses._replace(rows=begun.rows)
        more = Growth(find_tracks(found, pairs), pairs, lens, course.options.seed)
        if not _grow(course, more, len(models)):
            break
        models.append(more)
    # The largest is first; if two have one size, the one with more places.
    return sorted(models, key=lambda m: (-int(m.placed.sum()), -int(m.active.sum())))


def _keypoints(course: Course, heap: Heap) -> list[Keypoints]:
    rt, options, book, say = course
    found = []
    for i in range(len(heap.small)):
        say(i, len(heap.small), "Keypoints")
        kept = book.kept(f"keypoints-{i}")
        if kept is None:
            one = find_keypoints(rt, heap, i, options.most)
            here = {name: as_host(rt, value) for name, value in one._asdict().items()}
            book.note(f"keypoints-{i}", here)
        else:
            one = Keypoints(**kept | {"descriptors": rt.give(kept["descriptors"])})
        found.append(one)
    return found


def _matches(course: Course, found: list[Keypoints]) -> Matched:
    rt, options, book, say = course
    say(0, 1, "Choosing pairs")
    kept = book.kept("pairs")
    pairs = kept["pairs"] if kept else choose_pairs(rt, found, options.pairs, options.neighbors)
    if kept is None:
        book.note("pairs", {"pairs": pairs})
    together = Matched(np.zeros((0, 2), int), [])
    for begin in range(0, len(pairs), TOGETHER):
        say(begin, len(pairs), "Matching")
        kept = book.kept(f"matches-{begin}")
        if kept is None:
            part = match(rt, found, pairs[begin : begin + TOGETHER])
            book.note(f"matches-{begin}", {"pairs": part.pairs, **_joined(part.places)})
        else:
            part = Matched(kept["pairs"], _parted(kept))
        together = Matched(
            np.concatenate((together.pairs, part.pairs)), together.places + part.places
        )
    return together


def _joined(places: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Return places of pairs as two arrays."""
    sizes = np.array([len(p) for p in places], int)
    return {"sizes": sizes, "places": np.concatenate([np.zeros((0, 2), int), *places])}


def _parted(kept: dict[str, np.ndarray]) -> list[np.ndarray]:
    return np.split(kept["places"], np.cumsum(kept["sizes"])[:-1]) if len(kept["sizes"]) else []


def _begun(
    course: Course, found: list[Keypoints], matched: Matched, lenses: Lenses
) -> Growth | None:
    """Return the first photographs of the best of the likely lenses; None if there are none."""
    _, options, book, say = course
    say(0, 1, "Focal length")
    kept = book.kept("lenses")
    if kept is None:
        choices = with_focals(found, matched, lenses, options.seed)
        book.note("lenses", {"rows": np.stack([c.rows for c in choices])})
    else:
        choices = [lenses._replace(rows=rows) for rows in kept["rows"]]
    best, score = None, -math.inf
    for k, chosen in enumerate(choices):
        say(k, len(choices), "Verifying pairs")
        pairs = _verified(course, found, matched, chosen, k)
        growth = Growth(find_tracks(found, pairs), pairs, chosen, options.seed)
        state = book.kept(f"trial-{k}")
        if state is not None:
            growth.restore(state)
        else:
            if growth.begin() and len(choices) > 1:
                growth.grow(say, TRIAL)
            book.note(f"trial-{k}", growth.state())
        number, error = growth.cost()
        good = number * max(0.0, 1 - error / WORST)
        if growth.placed.any() and good > score:
            best, score = growth, good
    return best


def _verified(
    course: Course, found: list[Keypoints], matched: Matched, lenses: Lenses, k: int
) -> list[Pair]:
    kept = course.book.kept(f"verified-{k}")
    if kept is not None:
        rows = zip(
            kept["first"].tolist(), kept["second"].tolist(), _parted(kept), kept["flat"].tolist(),
            kept["rotation"], kept["translation"], kept["other"], strict=True,
        )  # fmt: skip
        return [Pair(*row) for row in rows]
    pairs = consistent(verify(found, matched, lenses, course.options.seed), len(found))
    pairs = agreeing(pairs, len(found))
    columns: dict[str, Any] = {
        name: np.array([getattr(p, name) for p in pairs])
        for name in ("first", "second", "flat", "rotation", "translation", "other")
    }
    course.book.note(f"verified-{k}", columns | _joined([p.places for p in pairs]))
    return pairs


def _grow(course: Course, growth: Growth, number: int) -> bool:
    """Let a model grow to its end; False if it cannot begin."""
    _, _, book, say = course
    name = f"model-{number}"
    state, last = book.kept(name), time.monotonic()
    if state is not None:
        growth.restore(state)
    elif not growth.placed.any() and not growth.begin():
        return False

    def save(at_once: bool = False) -> None:
        nonlocal last
        if at_once or time.monotonic() - last >= SAVE_EVERY:
            book.note(name, growth.state())
            last = time.monotonic()

    if not growth.rounds:
        growth.grow(say, save=save)
        growth.rounds = 1
        save(True)
    while growth.rounds <= ROUNDS:
        say(growth.rounds - 1, ROUNDS, "Adjusting everything")
        done = growth.settle(last=True)
        growth.rounds = ROUNDS + 1 if done else growth.rounds + 1
        save(True)
    return True
