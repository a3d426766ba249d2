"""Evidence of patches for objects at given places, in Taichi.

A patch within the frame of an object is evidence for it: the sum of the weights of its words for
the cell of the frame in which it lies. A frame has a layer of cells for patches of each size; a
layer takes the patches of the level whose scale is nearest to its own.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import NOBODY, Frame, Patches, Space
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.recognition.votes import _below, _factor, _scaled

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_two = ti.types.vector(2, ti.i32)


@ti.func
def _level(levels: ti.template(), scale: ti.i32) -> ti.i32:
    """Return the level whose scale is nearest, the first of several."""
    found = 0
    for level in range(1, levels.shape[0]):
        if ti.abs(levels[level, 0] - scale) < ti.abs(levels[found, 0] - scale):
            found = level
    return found


@ti.func
def _cell(layers: ti.template(), b: ti.i32, dy: ti.i32, dx: ti.i32, factor: ti.i32) -> ti.i32:
    """Return the cell of a layer at a distance from the middle, or -1 outside of its frame."""
    height = layers[b, 0]
    width = layers[b, 1]
    y = _below(dy, factor) + height
    x = _below(dx, factor) + width
    found = -1
    if 0 <= y < 2 * height and 0 <= x < 2 * width:
        row = y * layers[b, 2] // (2 * height)
        found = layers[b, 5] + row * layers[b, 3] + x * layers[b, 3] // (2 * width)
    return found


@ti.func
def _evidence(
    places: ti.template(),
    rows: ti.template(),
    levels: ti.template(),
    matches: ti.template(),
    weights: ti.template(),
    modes: ti.template(),
    t: ti.i32,
    by: ti.i32,
    factors: ti.template(),
    lowest: ti.i32,
    layers: ti.template(),
    box: ti.template(),
) -> ti.i32:
    """Return the evidence for mode t; if `by` is not -1, only that of patches in its box, too."""
    total = 0
    y = modes[t, 0]
    x = modes[t, 1]
    other = by
    if by < 0:
        other = t
    wide = _factor(factors, lowest, modes[other, 2])
    high = _scaled(box[0], wide)
    broad = _scaled(box[1], wide)
    for b in range(layers.shape[0]):
        level = _level(levels, modes[t, 2] + layers[b, 4])
        factor = _factor(factors, lowest, levels[level, 0])
        height = _scaled(layers[b, 0], factor) + 1
        width = _scaled(layers[b, 1], factor) + 1
        for row in range(levels[level, 1], levels[level, 2]):
            if ti.abs(rows[row, 0] - y) <= height:
                for i in range(rows[row, 1], rows[row, 2]):
                    dy = places[i, 0] - y
                    dx = places[i, 1] - x
                    cell = -1
                    if ti.abs(dx) <= width:
                        cell = _cell(layers, b, dy, dx, factor)
                    if by >= 0:
                        above = ti.abs(places[i, 0] - modes[other, 0]) > high
                        beside = ti.abs(places[i, 1] - modes[other, 1]) > broad
                        if above or beside:
                            cell = -1
                    if cell >= 0:
                        for m in range(matches.shape[1]):
                            if matches[i, m] != NOBODY:
                                total += weights[matches[i, m], cell]
    return total


@primitive
def weigh_evidence(
    patches: Patches,
    weights: np.ndarray,
    space: Space,
    frame: Frame,
    modes: np.ndarray,
    evidence: np.ndarray,
) -> None:
    """Add up the evidence of all patches for each of T modes; a thread a mode.

    `weights` (K, cells) are those of each word, cells row by row.
    """
    _weigh(
        *patches,
        weights,
        space.factors,
        space.lowest,
        frame.layers,
        i32_two(*frame[1:]),
        modes,
        evidence,
    )


@ti.kernel
def _weigh(
    places: i32_2,
    rows: i32_2,
    levels: i32_2,
    matches: i32_2,
    weights: i32_2,
    factors: i32_1,
    lowest: ti.i32,
    layers: i32_2,
    box: i32_two,
    modes: i32_2,
    # outputs
    evidence: i32_1,
):
    for t in range(modes.shape[0]):
        evidence[t] = _evidence(
            places, rows, levels, matches, weights, modes, t, -1, factors, lowest, layers, box
        )


@primitive
def weigh_overlaps(
    patches: Patches,
    weights: np.ndarray,
    space: Space,
    frame: Frame,
    modes: np.ndarray,
    shared: np.ndarray,
) -> None:
    """Add up the evidence for mode i of the patches in the box of mode j, (T, T); a thread a pair.

    The box is that of the mode's scale.
    """
    _weigh_pairs(
        *patches,
        weights,
        space.factors,
        space.lowest,
        frame.layers,
        i32_two(*frame[1:]),
        modes,
        shared,
    )


@ti.kernel
def _weigh_pairs(
    places: i32_2,
    rows: i32_2,
    levels: i32_2,
    matches: i32_2,
    weights: i32_2,
    factors: i32_1,
    lowest: ti.i32,
    layers: i32_2,
    box: i32_two,
    modes: i32_2,
    # outputs
    shared: i32_2,
):
    for i, j in shared:
        shared[i, j] = _evidence(
            places, rows, levels, matches, weights, modes, i, j, factors, lowest, layers, box
        )
