"""The search of a picture for objects: patches, votes, modes, evidence, description.

All of it is done by kernels, on arrays of fixed sizes: the host reads the result once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_number
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.recognition import MOST_HYPOTHESES, UNIT, Occurrences, Patches
from cvkern.recognition._arguments import check_picture, check_scales
from cvkern.recognition._kept import kept
from cvkern.recognition.choices import explain
from cvkern.recognition.figures import PAINTED, Painter
from cvkern.recognition.fitting import Fitted, frame_on
from cvkern.recognition.hypotheses import Judge, climb, weigh
from cvkern.recognition.modes import find_modes
from cvkern.recognition.patches import Places, cut, fill, find_places, prepare, pyramid_of, sent
from cvkern.recognition.training import Settings
from cvkern.recognition.votes import Hall, activate, hall_on, layout

HOPE = 6  # evidence below the threshold from which on a mode climbs
ROOM = 2**20  # votes that a GPU has room for, at first

_rooms: dict[str, int] = {}  # votes that each device has had room for


class Found(NamedTuple):
    """What a search found in a picture."""

    rt: Runtime
    shape: tuple[int, int]
    scales: tuple[float, ...]
    hall: Hall
    sums: Any
    """Sum of the weights of votes in each cell, (C,) int32, for kernels."""
    number: int
    """Number of objects."""
    modes: Any
    """A row that has their number; row, column, scale and evidence of each, for kernels."""
    painter: Painter | None
    """What paints figures; None if there are none."""


def search(
    image: Any,
    scales: Any,
    threshold: float | None,
    data_range: float | None,
    settings: Settings,
    fitted: Fitted,
    painted: bool = False,
) -> Found:
    """Return the objects in a picture, with their figures if `painted`."""
    image, white = check_picture(image, "image", data_range)
    sizes = check_scales(scales, fitted.usual)
    least = fitted.threshold if threshold is None else check_number(threshold, "threshold")
    floor = int(np.ceil(np.clip(least * UNIT, -(2**30), 2**30))) - fitted.bias
    rt = runtime(image)
    shape = int(image.shape[0]), int(image.shape[1])
    sampling, side = settings.sampling, settings.sampling.side
    pyramid = pyramid_of(shape, settings.sizes(sizes))
    pixels = prepare(rt, image, white, pyramid)
    places = find_places(rt, image, white, pixels, pyramid, sampling)
    hall = hall_on(rt, shape, sizes, (settings.height, settings.width))
    sums = rt.scratch("recognition.cells", (cells_of(shape, sizes),), np.int32)
    modes = rt.scratch("recognition.found", (MOST_HYPOTHESES + 1, 4), np.int32)
    balance = None
    if painted:
        sides = settings.height + 2 * side, settings.width + 2 * side
        balance = rt.scratch("recognition.balance", (PAINTED, *sides), np.int32)
    if not len(places.places):
        rt.clear(sums)
        return Found(rt, shape, sizes, hall, sums, 0, modes, None)
    corners, where, rows, levels = (
        sent(rt, name, array, sampling) for name, array in zip(Places._fields, places, strict=True)
    )
    words, weights = kept(rt, fitted.words), kept(rt, fitted.weights)
    occurrences = Occurrences(kept(rt, fitted.starts), kept(rt, fitted.entries))
    figures = kept(rt, fitted.figures) if painted else None
    frame = frame_on(rt, settings)
    matches = rt.scratch("recognition.matches", (len(places.places), settings.most), np.int32)
    patches = Patches(where, rows, levels, matches)
    painter = None
    if painted:
        painter = Painter(rt, patches, occurrences, hall, frame, figures, balance)
    room = _rooms.get(rt.device, ROOM)

    def run() -> None:
        """Launch all kernels."""
        if sampling.points == "grid":
            fill(rt, pixels, pyramid)
        activate(rt, cut(rt, pixels, corners, sampling), words, settings.least, matches)
        own, starts = find_modes(rt, patches, occurrences, hall, sums, room)
        judge = Judge(rt, patches, weights, hall.space, frame)
        promising = max(floor - HOPE * UNIT, -(2**31))
        climbed = climb(judge, own, weigh(judge, own), promising)
        explain(judge, *climbed, starts, floor, modes)
        if painter:
            painter.paint(modes)

    given = pixels, corners, *patches, words, weights, *occurrences, hall.space.bins, hall.tiles
    given += hall.space.factors, hall.spans, frame.layers, sums, modes
    given += (figures, balance) if painted else ()
    while True:
        key = "recognition.search", settings, sizes, shape, floor, room
        if sampling.points == "grid":
            rt.repeat(key, run, given)
        else:
            run()
        number, votes = (int(n) for n in rt.to_numpy(modes)[0, :2])
        if rt.device == "cpu" or votes <= room:
            break
        room = _rooms[rt.device] = 1 << (votes - 1).bit_length()
    return Found(rt, shape, sizes, hall, sums, number, modes, painter)


def cells_of(shape: tuple[int, int], sizes: tuple[float, ...]) -> int:
    """Return the number of cells for votes."""
    bins = layout(shape, sizes)[0].bins
    return int(bins[-1, 0] + bins[-1, 1] * bins[-1, 2])


def votes_of(found: Found) -> list[np.ndarray]:
    """Return the sums of the cells of each scale, on the host."""
    bins = layout(found.shape, found.scales)[0].bins.tolist()
    sums = np.array(found.rt.to_numpy(found.sums))
    return [
        sums[first : first + rows * columns].reshape(rows, columns)
        for first, rows, columns, _, _ in bins
    ]
