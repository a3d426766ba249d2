"""Evidence of patches for objects at given places, in Taichi.

A patch within the frame of an object is evidence for it: the sum of the weights of its words for
the cell of the frame in which it lies. A frame has a layer of cells for patches of each size; a
layer takes the patches of the level whose scale is nearest to its own.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import CLIMBED, FINE, NOBODY, Frame, Patches, Space
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.recognition.votes import _below, _factor, _scaled

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
i32_two = ti.types.vector(2, ti.i32)
vec3i = ti.types.vector(3, ti.i32)


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
    mode: vec3i,
    bounded: ti.i32,
    by: vec3i,
    factors: ti.template(),
    lowest: ti.i32,
    layers: ti.template(),
    box: ti.template(),
) -> ti.i32:
    """Return the evidence for a mode; if bounded, only that of patches in another's box."""
    total = 0
    y = mode[0]
    x = mode[1]
    wide = _factor(factors, lowest, by[2])
    high = _scaled(box[0], wide)
    broad = _scaled(box[1], wide)
    for b in range(layers.shape[0]):
        level = _level(levels, mode[2] + layers[b, 4])
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
                    if bounded == 1:
                        above = ti.abs(places[i, 0] - by[0]) > high
                        beside = ti.abs(places[i, 1] - by[1]) > broad
                        if above or beside:
                            cell = -1
                    if cell >= 0:
                        for m in range(matches.shape[1]):
                            if matches[i, m] != NOBODY:
                                total += weights[matches[i, m], cell]
    return total


@ti.func
def _place(modes: ti.template(), t: ti.i32) -> vec3i:
    return vec3i(modes[t, 0], modes[t, 1], modes[t, 2])


@primitive
def weigh_evidence(
    patches: Patches,
    weights: np.ndarray,
    space: Space,
    frame: Frame,
    modes: np.ndarray,
    evidence: np.ndarray,
) -> None:
    """Add up the evidence of all patches for each of T modes; modes of density 0 have none.

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
        total = 0
        if modes[t, 3] > 0:
            mode = _place(modes, t)
            total = _evidence(
                places, rows, levels, matches, weights, mode, 0, mode, factors, lowest, layers, box
            )
        evidence[t] = total


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

    The box is that of the mode's scale. Modes of density 0 have no evidence, and share none.
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
        total = 0
        if modes[i, 3] > 0 and modes[j, 3] > 0:
            mode, by = _place(modes, i), _place(modes, j)
            total = _evidence(
                places, rows, levels, matches, weights, mode, 1, by, factors, lowest, layers, box
            )
        shared[i, j] = total


@primitive
def climb_modes(
    patches: Patches,
    weights: np.ndarray,
    space: Space,
    frame: Frame,
    step: int,
    least: int,
    modes: np.ndarray,
    evidence: np.ndarray,
    moved: np.ndarray,
    found: np.ndarray,
) -> None:
    """Move each of T modes to the place with most evidence among its own and eight round it.

    Those are `step` pixels of the model away; the first wins a tie: the mode's own, then those to
    the left and right, then those above, then those below. A mode whose `evidence` (T,) is below
    `least` gets density 0. `found` (T,) is the evidence there.
    """
    around = scratch((modes.shape[0], CLIMBED, 4), np.int32)
    _look_around(space.factors, space.lowest, step, least, modes, evidence, around)
    flat = around.reshape((modes.shape[0] * CLIMBED, 4))
    total = scratch((flat.shape[0],), np.int32)
    weigh_evidence(patches, weights, space, frame, flat, total)
    _climb(flat, total, least, modes, evidence, moved, found)


@ti.kernel
def _look_around(
    factors: i32_1,
    lowest: ti.i32,
    step: ti.i32,
    least: ti.i32,
    modes: i32_2,
    evidence: i32_1,
    # outputs
    around: i32_3,  # (T, 9, 4)
):
    for t in range(modes.shape[0]):
        apart = _scaled(FINE * step, _factor(factors, lowest, modes[t, 2]))
        for k in range(CLIMBED):
            # 0, then before, then behind
            down = 0
            along = 0
            if k // 3 > 0:
                down = 2 * (k // 3) - 3
            if k % 3 > 0:
                along = 2 * (k % 3) - 3
            around[t, k, 0] = modes[t, 0] + down * apart
            around[t, k, 1] = modes[t, 1] + along * apart
            around[t, k, 2] = modes[t, 2]
            around[t, k, 3] = ti.select(evidence[t] >= least, modes[t, 3], 0)


@ti.kernel
def _climb(
    around: i32_2,  # (9 T, 4)
    total: i32_1,
    least: ti.i32,
    modes: i32_2,
    evidence: i32_1,
    # outputs
    moved: i32_2,
    found: i32_1,
):
    for t in range(modes.shape[0]):
        top = evidence[t]
        best = CLIMBED * t
        if around[best, 3] > 0:
            for k in range(CLIMBED):
                if total[CLIMBED * t + k] > top:
                    top = total[CLIMBED * t + k]
                    best = CLIMBED * t + k
        for k in range(4):
            moved[t, k] = around[best, k]
        found[t] = top
