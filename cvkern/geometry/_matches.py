"""The matches of a batch of pairs of images, sorted and scaled for robust fits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.geometry import LANES


class Batch(NamedTuple):
    """The matches of several pairs, as kernels take them."""

    matches: Any
    """x0, y0, x1, y1, and z0 of scenes, within [-1, 1], (4 or 5, M) float32, a kernel array; a pair
    begins at a multiple of `LANES`."""
    spans: np.ndarray
    """First and number of the matches of each pair, (P, 2) int32."""
    places: np.ndarray
    """Where each match is in `matches`, (N,) int32; -1 for those that are not finite."""
    to_unit: np.ndarray
    """The matrices that scale the points of either image, (2, P, 3, 3) float64."""
    sides: np.ndarray
    """Width and height of the box of the scaled points of the second image, (P, 2) float64."""
    deep: np.ndarray
    """Offset of the scaled z0 of scenes, (P,) float64."""


def gather(
    rt: Runtime, pairs: Sequence[tuple[np.ndarray, np.ndarray]], *, alike: bool = False
) -> Batch:
    """Scale the matches of each pair, in the order of a hash of their coordinates, equal ones once.

    Points are (row, column), or in the first list (x, y, z) of a scene. Any order of the same
    matches gives the same batch, and its first matches are as good as drawn by lot. The centre and
    the scale (a power of two, of both images if `alike`) are those of the points' box, which no
    order rounds otherwise.
    """
    kernels = rt.geometry.matches
    numbers = np.array([len(a) for a, _ in pairs], np.int64)
    rooms = -(-numbers // LANES) * LANES
    spans = np.stack((np.cumsum(numbers) - numbers, numbers, np.cumsum(rooms) - rooms), 1)
    rows, count = 2 + pairs[0][0].shape[1], len(pairs)
    total = int(numbers.sum())
    points0 = rt.send("robust.points0", _together([a for a, _ in pairs], rows - 2))
    points1 = rt.send("robust.points1", _together([b for _, b in pairs], 2))
    sent = rt.send("robust.lists", spans.astype(np.int32))
    order, places = (
        rt.scratch(f"robust.{name}", (max(total, 1),), np.int32) for name in ("order", "places")
    )
    counts = rt.scratch("robust.counts", (count,), np.int32)
    boxes = rt.scratch("robust.boxes", (count, 2, rows), np.float64)
    kernels.sort_matches(points0, points1, sent, order, places, counts, boxes)
    low, high = np.array(rt.to_numpy(boxes)).swapaxes(0, 1)
    found = np.array(rt.to_numpy(counts))
    second = np.arange(rows) // 2 == 1  # x1, y1
    half = (high - low) / 2
    sides = np.stack([half[:, ~second].max(axis=1), half[:, second].max(axis=1)], 1)
    half = (np.repeat(sides.max(axis=1, keepdims=True), 2, 1) if alike else sides)[
        :, second.astype(int)
    ]
    scale = np.ldexp(1.0, -np.frexp(np.where(half > 0, half, 1.0))[1])
    scale[found == 0] = 1.0
    shift = scale * (low + high) / 2
    matches = rt.scratch("robust.matches", (rows, max(int(rooms.sum()), LANES)))
    scales = rt.send("robust.scales", np.stack((scale, shift), 1))
    kernels.scale_matches(points0, points1, sent, order, counts, scales, matches)
    to_unit = np.zeros((2, count, 3, 3))
    to_unit[..., 2, 2] = 1
    for i in (0, 1):
        for k in (0, 1):
            to_unit[i, :, k, k] = scale[:, 2 * i + k]
            to_unit[i, :, k, 2] = -shift[:, 2 * i + k]
    return Batch(
        matches,
        np.stack((spans[:, 2], found), 1).astype(np.int32),
        np.array(rt.to_numpy(places))[:total],
        to_unit,
        ((high - low) * scale)[:, 2:4],
        -shift[:, 4] if rows == 5 else np.zeros(count),
    )


def _together(lists: list[np.ndarray], columns: int) -> np.ndarray:
    """Return all points, or one if there is none."""
    if not any(map(len, lists)):
        return np.zeros((1, columns))
    return np.ascontiguousarray(np.concatenate(lists), np.float64)
