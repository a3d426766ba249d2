"""Exposures that a hand-held camera took, moved above each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_integer
from cvkern._order import floats_of
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.raw import GREYS, MOVES, PARTS
from cvkern.raw.demosaicing import CARRIED
from cvkern.raw.exposures import stacked

NOISE = (GREYS - 1) * 4 // 255  # levels about the median that do not count
GREY = (("grey", np.float32), ("levels", np.int32))


class Alignment(NamedTuple):
    """Exposures that lie above each other, and how they were moved."""

    images: Any
    """The exposures, of the shape and dtype given; beyond a border the last pixels are repeated."""
    shifts: np.ndarray
    """(K, 2) int64: rows and columns that each was moved by."""


def align_exposures(images: Any, *, reach: int = 64) -> Alignment:
    """Align exposures that a hand-held camera took, by whole pixels.

    Parameters
    ----------
    images : array of shape (K, H, W) or (K, H, W, 3)
        Exposures, any real dtype. NumPy also takes a sequence of images.
    reach : int, default 64
        Pixels that an image may be off the one in the middle, in each direction.

    Returns
    -------
    Alignment
        Named tuple of the moved `images` and their `shifts`, (0, 0) for the middle one.

    Raises
    ------
    TypeError
        If `images` do not hold real numbers.
    ValueError
        If there are fewer than two images, shapes differ, or `reach` is not in 1 to 1024.

    Notes
    -----
    Median threshold bitmaps [1]_: whether a pixel is above its image's median hardly depends on
    exposure. From coarse to fine, each level tries the nine moves by one pixel, and keeps the one
    with the smallest share of pixels that differ, the shortest move on a tie. Levels of 16 bits
    stand for the mean of the channels, so that all that is compared are integers: equal on all
    devices. Values that are not finite count as 0.

    References
    ----------
    .. [1] G. Ward, "Fast, robust image registration for compositing high dynamic range photographs
       from hand-held exposures", Journal of Graphics Tools 8, 2003.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.random.default_rng(0).random((64, 80))
    >>> images = np.stack([scene, np.roll(scene, (3, -2), (0, 1)) / 2])
    >>> cvkern.align_exposures(images, reach=8).shifts
    array([[ 0,  0],
           [-3,  2]])
    """
    images, shape = stacked(images)
    reach = check_integer(reach, "reach", 1, 1024)
    rt = runtime(images)
    levels, low, units = _graded(rt, images, shape)
    grey = [levels]
    least = min(shape[1:3])
    for n in range(min(math.ceil(math.log2(reach)), max(int(math.log2(least / 8)), 0))):
        sides = (grey[n].shape[1] // 2, grey[n].shape[2] // 2)
        grey.append(rt.scratch(f"align.level{n + 1}", (shape[0], *sides), np.int32))
        rt.raw.alignment.halve(grey[n], grey[n + 1])
    sides, medians = zip(*(_split(rt, n, level) for n, level in enumerate(grey)), strict=True)
    fixed = _middle(low + rt.to_numpy(medians[0]) / units, 2 / float(units.min()))
    shifts = _shifts(rt, sides, fixed)
    if library(images).writable:
        return Alignment(_moved(images, shifts), shifts)
    host = np.asarray(rt.to_numpy(rt.adopt(images, library(images).dtype(images))))
    return Alignment(rt.give(_moved(host, shifts)), shifts)


def _graded(rt: Runtime, images: Any, shape: tuple[int, ...]) -> tuple[Any, np.ndarray, np.ndarray]:
    """Return levels of grey (K, H, W), and of each image the least value and the levels a unit."""
    count, height, width, channels = shape
    flat = (count, height * width)
    grey, levels = (rt.scratch(f"align.{n}", flat, t) for n, t in GREY)
    ends = rt.scratch("align.ends", (count, 2), np.int64)
    rt.clear(ends)
    kernels = rt.raw.alignment
    dtype = library(images).dtype(images)
    carried = dtype if dtype in CARRIED else np.dtype(np.float32)
    kernels.mix(rt.adopt(images, carried, (*flat, channels)), 1 / channels, grey, ends)
    found = np.array(rt.to_numpy(ends))
    keys = (np.stack([2**32 - found[:, 0], found[:, 1]]) - 2**31).astype(np.int32)
    low, high = floats_of(keys).astype(np.float64)
    units = (GREYS - 1) / np.where(high > low, high - low, 1)
    scales = np.stack([low, units], axis=1).astype(np.float32)
    kernels.grade(grey, rt.send("align.scales", scales), levels)
    return levels.reshape(shape[:3]), low, units


def _middle(values: np.ndarray, apart: float) -> int:
    """Return which of the values is in the middle; those less `apart` are equal, in their order."""
    order = np.argsort(values, kind="stable")
    ranks = np.zeros(len(values), np.int64)
    ranks[order[1:]] = np.cumsum(np.diff(values[order]) > apart)
    return int(np.argsort(ranks, kind="stable")[len(values) // 2])


def _split(rt: Runtime, n: int, levels: Any) -> tuple[Any, Any]:
    """Return on which side of its image's lower median each pixel is, and these medians."""
    shape = levels.shape
    flat = levels.reshape((shape[0], shape[1] * shape[2]))
    counts = rt.scratch("align.counts", (shape[0], GREYS), np.int32)
    rt.clear(counts)
    rt.raw.alignment.count(flat, counts)
    medians = rt.scratch(f"align.medians{n}", (shape[0],), np.int32)
    rt.raw.alignment.medians(counts, medians)
    sides = rt.scratch(f"align.sides{n}", tuple(flat.shape), np.uint8)
    rt.raw.alignment.split(flat, medians, NOISE, sides)
    return sides.reshape(shape), medians


def _shifts(rt: Runtime, sides: Sequence[Any], fixed: int) -> np.ndarray:
    """Return the rows and columns by which each image is moved to lie above the fixed one."""
    count = sides[0].shape[0]
    shifts = rt.scratch("align.shifts", (count, 2), np.int32)
    sums = rt.scratch("align.sums", (count, PARTS, len(MOVES)), np.int32)
    rt.clear(shifts)
    for level in sides[::-1]:
        rt.clear(sums)
        rt.raw.alignment.compare(level, fixed, shifts, sums)
        _, height, width = level.shape
        rt.raw.alignment.choose(sums, height, width, shifts)
    return rt.to_numpy(shifts).astype(np.int64)


def _moved(images: Any, shifts: np.ndarray) -> Any:
    """Move images of any library, and repeat their last pixels."""
    moved = images * 1  # a copy, in any library
    height, width = images.shape[1:3]
    for k, (dy, dx) in enumerate(shifts.tolist()):
        dy, dx = max(-height + 1, min(dy, height - 1)), max(-width + 1, min(dx, width - 1))
        rows = slice(max(dy, 0), height + min(dy, 0))
        columns = slice(max(dx, 0), width + min(dx, 0))
        own = images[k, max(-dy, 0) : height - max(dy, 0), max(-dx, 0) : width - max(dx, 0)]
        moved[k, rows, columns] = own
        moved[k, rows, : columns.start] = moved[k, rows, columns.start : columns.start + 1]
        moved[k, rows, columns.stop :] = moved[k, rows, columns.stop - 1 : columns.stop]
        moved[k, : rows.start] = moved[k, rows.start : rows.start + 1]
        moved[k, rows.stop :] = moved[k, rows.stop - 1 : rows.stop]
    return moved
