"""The steps of learning a shape model from objects and negatives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import FINE, NOBODY, OCTAVE, Frame, Patches, Space
from cvkern.recognition._kept import kept
from cvkern.recognition.codebook import cluster
from cvkern.recognition.hypotheses import Judge, climb, weigh
from cvkern.recognition.modes import distinct
from cvkern.recognition.training import (
    DOUBTFUL,
    HARDEST,
    MOST_TRAINED,
    ROUNDS,
    SPREAD_RARE,
    UNIT,
    ZOOMS,
    Example,
    Factors,
    Learnt,
    Settings,
    Window,
    columns,
    dense_modes,
    frame_of,
    halves,
    look,
    occurrences_of,
    quantised,
    separate,
    surprise,
    window_at,
)
from cvkern.recognition.votes import layout

SHEET = 2.5  # least sides of a negative, in sides of the object's box; smaller ones are mirrored
MOST_PASTED = 100  # negatives that objects are put into
FEW = 200  # objects, below which they are seen from more grids
NEAR = 0.3  # part of a box: places as near to an object are the object
OTHER_SIZE = OCTAVE // 3  # steps of scale: sizes so far from an object's are not the object


# The patches of a picture, its shape, and the middle of the object in it, if there is one.
Scene = tuple[Example, tuple[int, ...], np.ndarray | None]


class Fitted(NamedTuple):
    """What a model has learnt, on the host."""

    words: np.ndarray
    """Normalised patches (K, D) int8."""
    starts: np.ndarray
    """First occurrence of each word, and their number, (K + 1,) int32."""
    entries: np.ndarray
    """Occurrences: rows and columns to the centre, scale, weight, (O, 4) int32."""
    figures: np.ndarray
    """Share of the object in each pixel of each occurrence, (O, S S) uint8, or (0, 0)."""
    weights: np.ndarray
    """Evidence of each word in each cell of the frame, (K, cells) int32."""
    bias: int
    """Evidence of an empty frame."""
    threshold: float
    """Least score of an object, by default."""
    usual: float = 1.0
    """Size of the median object that was learnt, in sizes of the model."""


def fit(
    rt: Runtime,
    objects: np.ndarray,
    masks: np.ndarray | None,
    negatives: list[np.ndarray],
    settings: Settings,
) -> Fitted:
    """Learn from objects (N, h, w) in parts of white, and from pictures without any."""
    firsts = grids_of(settings, len(objects))
    of_words = firsts[: 1 if len(objects) >= FEW else 2]
    patches = np.concatenate(
        [
            look(rt, picture, settings, None, first=f).patches
            for picture in objects
            for f in of_words
        ]
    )
    patches = patches[patches.any(axis=1)]
    if not len(patches):
        raise ValueError("images must have patches that are not flat, got none")
    patches = patches[:: -(-len(patches) // MOST_TRAINED)]
    words, _ = cluster(
        rt, patches, settings.words, settings.method, settings.correlation, settings.sampling
    )
    count, cells = len(words), settings.cells
    seen = [look(rt, picture, settings, words, first=f) for picture in objects for f in firsts]
    shown = [None if masks is None else masks[i // len(firsts)] for i in range(len(seen))]
    starts, entries, figures = occurrences_of(seen, shown, settings, count)
    middle = np.r_[settings.middle, 0]
    factors = factors_of(layout((1, 1), ZOOMS)[0])
    found = [window_at(example, middle, factors, settings) for example in seen]
    if not negatives:
        learnt = quantised(surprise(found, count, cells), 0.0, count)
        totals = [learnt.weights[w.words, w.cells].sum() for w in found]
        threshold = float(np.median(totals)) / UNIT / 2
    else:
        sheets = [sheet_of(negative, settings) for negative in negatives]
        backgrounds = [look(rt, sheet, settings, words, ZOOMS) for sheet in sheets]
        entries = discounted(entries, starts, seen, backgrounds, settings)
        learnt = learn_evidence(rt, objects, sheets, backgrounds, found, words, firsts, settings)
        threshold = 0.0
    return Fitted(
        words, starts, entries, np.empty((0, 0), np.uint8) if figures is None else figures,
        learnt.weights, learnt.bias, threshold,
    )  # fmt: skip


def grids_of(settings: Settings, count: int) -> list[tuple[int, int]]:
    """Return first pixels of grids that each of `count` objects is seen from.

    An object in a photograph begins anywhere between the points of its grid. Many objects vary by a
    pixel themselves; few are seen from twice as many grids.
    """
    step = settings.sampling.step
    if settings.sampling.points != "grid" or step == 1:
        return [(0, 0)]
    half, quarter = step // 2, step // 4
    firsts = [(0, 0), (half, half), (0, half), (half, 0)]
    if count < FEW and quarter:
        firsts += [(row + quarter, column + quarter) for row, column in firsts]
    return firsts


def sheet_of(negative: np.ndarray, settings: Settings) -> np.ndarray:
    """Return a negative that is large enough to look for objects, mirrored at its borders."""
    missing = [
        max(0, int(SHEET * size) - side)
        for side, size in zip(negative.shape, (settings.height, settings.width), strict=True)
    ]
    return np.pad(negative, [(m // 2, m - m // 2) for m in missing], mode="symmetric")


def discounted(
    entries: np.ndarray,
    starts: np.ndarray,
    objects: list[Example],
    backgrounds: list[Example],
    settings: Settings,
) -> np.ndarray:
    """Multiply the votes of a word by the share of its activations that is on objects."""
    count = len(starts) - 1

    def rate(examples: list[Example]) -> np.ndarray:
        """Return activations of each word in a patch."""
        words = np.concatenate([e.matches[e.matches != NOBODY] for e in examples])
        return np.bincount(words, minlength=count) / max(sum(len(e.matches) for e in examples), 1)

    own, other = rate(objects), rate(backgrounds)
    total = own + other + SPREAD_RARE * own.sum() / count
    share = np.divide(own, total, out=np.zeros(count), where=total > 0)
    entries[:, 3] = np.floor(entries[:, 3] * np.repeat(share, np.diff(starts)))
    return entries


def learn_evidence(
    rt: Runtime,
    objects: np.ndarray,
    sheets: list[np.ndarray],
    backgrounds: list[Example],
    found: list[Window],
    words: np.ndarray,
    firsts: list[tuple[int, int]],
    settings: Settings,
) -> Learnt:
    """Learn weights by logistic regression, in rounds: each adds the mistakes of the one before.

    Objects come whole and half hidden. Negatives are places of the sheets, and places beside
    objects that are put into sheets.
    """
    count, cells = len(words), settings.cells
    where = np.r_[settings.middle, 0], factors_of(layout((1, 1), ZOOMS)[0])
    behind = [
        window_at(look(rt, hidden, settings, words, first=f), *where, settings)
        for thing in objects
        for hidden in half_hidden(thing)
        for f in firsts[:2]
    ]
    own = columns(halves(found) + behind, count, cells)
    scenes: list[Scene] = [
        (e, sheet.shape, None) for e, sheet in zip(backgrounds, sheets, strict=True)
    ]
    for number, sheet in enumerate(sheets[:MOST_PASTED]):
        pasted, place = paste(sheet, objects[number * len(objects) // len(sheets)])
        scenes.append((look(rt, pasted, settings, words, ZOOMS), sheet.shape, place))
    learnt = quantised(surprise(found, count, cells), 0.0, count)
    others: list[Window] = []
    taken: list[set[tuple[int, ...]]] = [set() for _ in scenes]
    floor = -np.inf
    for _ in range(ROUNDS):
        for scene, seen in zip(scenes, taken, strict=True):
            others += list(mistaken(rt, scene, seen, learnt, floor, settings))
        learnt = quantised(*separate(own, columns(others, count, cells)), count)
        floor = DOUBTFUL * UNIT
    return learnt


def half_hidden(thing: np.ndarray) -> Iterator[np.ndarray]:
    """Yield an object with either half, along its longer side, behind its mean grey."""
    along = int(thing.shape[1] >= thing.shape[0])
    middle = thing.shape[along] // 2
    for part in (slice(0, middle), slice(middle, None)):
        hidden = thing.copy()
        hidden[(slice(None), part) if along else (part, slice(None))] = thing.mean()
        yield hidden


def paste(sheet: np.ndarray, thing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a sheet with an object in its middle, and the middle of the object."""
    made = sheet.copy()
    first = (np.array(sheet.shape) - thing.shape) // 2
    made[tuple(slice(f, f + n) for f, n in zip(first, thing.shape, strict=True))] = thing
    return made, first + (np.array(thing.shape) - 1) / 2


def mistaken(
    rt: Runtime,
    scene: Scene,
    taken: set[tuple[int, ...]],
    learnt: Learnt,
    floor: float,
    settings: Settings,
) -> Iterator[Window]:
    """Yield the places without an object that have the most evidence for one."""
    example, shape, place = scene
    space, _, _ = layout((shape[0], shape[1]), ZOOMS)
    given = zip(Patches._fields, (*example.places[1:], example.matches), strict=True)
    patches = Patches(*(rt.send(f"recognition.{name}", array) for name, array in given))
    modes = np.concatenate([dense_modes(shape, settings, zoom) for zoom in ZOOMS])
    size = np.array([settings.height, settings.width])
    modes = beside(modes, place, size)
    weights = rt.send("recognition.weights", learnt.weights)
    known = space._replace(factors=rt.constant(space.factors))
    judge = Judge(rt, patches, weights, known, frame_on(rt, settings))
    found = weigh(judge, rt.send("recognition.dense", modes))
    evidence = np.array(rt.to_numpy(found)) + learnt.bias
    chosen: list[int] = []
    for index in np.argsort(-evidence.astype(np.int64), kind="stable").tolist():
        if evidence[index] < floor or len(chosen) == HARDEST:
            break
        near = modes[chosen] if chosen else np.empty((0, 4))
        apart = np.abs(near[:, :2] - modes[index, :2]) / FINE / size
        same = (apart < 0.1).all(axis=1) & (near[:, 2] == modes[index, 2])
        if not same.any():
            chosen.append(index)
    if not chosen:
        return
    sent = rt.send("recognition.dense", np.ascontiguousarray(modes[chosen]))
    known = rt.send("recognition.own", np.ascontiguousarray(evidence[chosen] - learnt.bias))
    modes = np.array(rt.to_numpy(climb(judge, sent, known, -(2**31))[0]))
    modes = modes[modes[:, 3] > 0]
    modes = modes[distinct(modes)]
    for mode in beside(modes, place, size)[:, :3]:
        if tuple(mode.tolist()) not in taken:
            taken.add(tuple(mode.tolist()))
            yield window_at(example, mode, factors_of(space), settings)


def beside(modes: np.ndarray, place: np.ndarray | None, size: np.ndarray) -> np.ndarray:
    """Return the modes that are not near to the place and the size of an object, if there is one.

    The object is of scale 0.
    """
    if place is None:
        return modes
    apart = np.abs(modes[:, :2] / FINE - place) / size
    return modes[(apart > NEAR).any(axis=1) | (np.abs(modes[:, 2]) >= OTHER_SIZE)]


def factors_of(space: Space) -> Factors:
    """Return a function of a scale: the size there, in parts of 2^16."""
    return lambda code: int(space.factors[code - space.lowest])


def frame_on(rt: Runtime, settings: Settings) -> Frame:
    """Return the frame for kernels."""
    frame = frame_of(settings)
    return frame._replace(layers=kept(rt, frame.layers))
