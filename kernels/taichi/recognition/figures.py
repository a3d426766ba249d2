"""Figures of objects, from the masks of the patches that voted for them, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import (
    FINE,
    KERNEL_ONE,
    OCTAVE,
    SHARE_BITS,
    UNIT,
    Frame,
    Occurrences,
    Patches,
    Space,
    Window,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.recognition.votes import (
    _active,
    _below,
    _bin,
    _cell,
    _factor,
    _kernel_at,
    _scaled,
)

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
vec3i = ti.types.vector(3, ti.i32)
i32_6 = ti.types.vector(6, ti.i32)


@primitive
def paint_figures(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    window: Window,
    frame: Frame,
    figures: np.ndarray,
    modes: np.ndarray,
    balance: np.ndarray,
) -> None:
    """Add up the evidence of the votes for each of the first T modes, pixel by pixel.

    The first row of `modes` (R + 1, 4) is their number, then come their rows, columns and scales.
    `figures` (O, S S) have the share of the object in each pixel at each occurrence, in parts of
    255. A vote adds its weight in the kernel times (2 share - 1) to `balance` (T, H, W), the box
    of the object at scale 0 with a margin. Pixels are the nearest ones. Two kinds of
    patches are left out: those whose size differs by half an octave, and those whose middle is
    farther from the mode than the box at their own size and the radius of the kernel. One thread a
    mode.
    """
    places, _, _, matches = patches
    bins, slack, factors, lowest = space
    given = i32_6(slack, lowest, window.radius, window.scales, frame.box_height, frame.box_width)
    _paint(places, matches, *occurrences, bins, factors, given, figures, modes, balance)


@ti.kernel
def _paint(
    places: i32_2,  # (N, 3)
    matches: i32_2,
    begins: i32_1,
    entries: i32_2,
    bins: i32_2,
    factors: i32_1,
    given: i32_6,
    figures: u8_2,
    modes: i32_2,  # (R + 1, 4)
    # outputs
    balance: i32_3,  # (T, H, W)
):
    slack, lowest, radius, scales = given[0], given[1], given[2], given[3]
    height = balance.shape[1]
    width = balance.shape[2]
    side = ti.cast(ti.sqrt(ti.cast(figures.shape[1], ti.f32)) + 0.5, ti.i32)
    for t in range(balance.shape[0]):
        for row, column in ti.ndrange(height, width):
            balance[t, row, column] = 0
        mode = vec3i(modes[t + 1, 0], modes[t + 1, 1], modes[t + 1, 2])
        own = _factor(factors, lowest, mode[2])
        reach = _scaled(radius, own)
        number = ti.select(t < modes[0, 0], places.shape[0], 0)
        for i in range(number):
            place = vec3i(places[i, 0], places[i, 1], places[i, 2])
            apart = place - mode
            factor = _factor(factors, lowest, place[2])
            near_box = (
                ti.abs(apart[2]) < OCTAVE // 2
                and ti.abs(apart[0]) <= _scaled(given[4], factor) + reach
                and ti.abs(apart[1]) <= _scaled(given[5], factor) + reach
            )
            if near_box:
                # First pixel of the patch in the box, halves rounded up.
                top = _below(apart[0], own) + FINE * (height - side) // 2
                left = _below(apart[1], own) + FINE * (width - side) // 2
                first = (top + FINE // 2) // FINE
                begin = (left + FINE // 2) // FINE
                active = _active(matches, i)
                for m in range(active):
                    word = matches[i, m]
                    for e in range(begins[word], begins[word + 1]):
                        down = _scaled(entries[e, 0], factor)
                        along = _scaled(entries[e, 1], factor)
                        vote = place + vec3i(down, along, entries[e, 2])
                        near = _kernel_at(vote - mode, reach, scales)
                        s = _bin(bins, vote[2], slack)
                        if near > 0 and _cell(bins, s, vote[0], vote[1]) >= 0:
                            weight = ti.cast(entries[e, 3] // active * near // KERNEL_ONE, ti.i32)
                            for k in range(figures.shape[1]):
                                row = first + k // side
                                column = begin + k % side
                                if 0 <= row < height and 0 <= column < width:
                                    share = ti.cast(figures[e, k], ti.i32)
                                    product = weight * (2 * share - 255)
                                    balance[t, row, column] += product >> SHARE_BITS


@primitive
def spread_figures(balance: np.ndarray, modes: np.ndarray, space: Space, masks: np.ndarray) -> None:
    """Set the pixels of an image that are of the object of each mode; a thread a pixel.

    `modes` are those of :func:`paint_figures`. `masks` (T, H, W) are 1 where the balance, linear
    between its pixels, is above 0.
    """
    _spread(balance, modes, space.factors, space.lowest, masks)


@ti.func
def _at(balance: ti.template(), t: ti.i32, row: ti.i32, column: ti.i32) -> ti.i64:
    value = ti.cast(0, ti.i64)
    if 0 <= row < balance.shape[1] and 0 <= column < balance.shape[2]:
        value = ti.cast(balance[t, row, column], ti.i64)
    return value


@ti.kernel
def _spread(
    balance: i32_3,
    modes: i32_2,
    factors: i32_1,
    lowest: ti.i32,
    # outputs
    masks: u8_3,
):
    for t, row, column in masks:
        factor = _factor(factors, lowest, modes[t + 1, 2])
        y = _below(FINE * row - modes[t + 1, 0], factor) + FINE * (balance.shape[1] - 1) // 2
        x = _below(FINE * column - modes[t + 1, 1], factor) + FINE * (balance.shape[2] - 1) // 2
        top = y // FINE
        left = x // FINE
        down = y - FINE * top
        along = x - FINE * left
        upper = (FINE - along) * _at(balance, t, top, left) + along * _at(balance, t, top, left + 1)
        lower = (FINE - along) * _at(balance, t, top + 1, left) + along * _at(
            balance, t, top + 1, left + 1
        )
        masks[t, row, column] = ti.cast((FINE - down) * upper + down * lower > 0, ti.u8)


@primitive
def describe_objects(
    modes: np.ndarray,
    sizes: np.ndarray,
    lowest: int,
    bias: int,
    boxes: np.ndarray,
    scores: np.ndarray,
    centers: np.ndarray,
    scales: np.ndarray,
) -> None:
    """Describe N objects in pixels and in float32: their boxes, scores, centers and scales.

    `modes` are those of :func:`paint_figures`, with the evidence of each. `sizes` (F, 3) float64
    are the scale, half the height and half the width of a box at each scale from `lowest` on.
    `bias` is added to the evidence, which is in parts of `UNIT`.
    """
    _describe(modes, sizes, lowest, bias, boxes, scores, centers, scales)


@ti.kernel
def _describe(
    modes: i32_2,  # (R + 1, 4)
    sizes: f64_2,  # (F, 3)
    lowest: ti.i32,
    bias: ti.i32,
    # outputs
    boxes: f32_2,  # (N, 4)
    scores: f32_1,
    centers: f32_2,  # (N, 2)
    scales: f32_1,
):
    for n in range(scores.shape[0]):
        size = ti.min(ti.max(modes[n + 1, 2] - lowest, 0), sizes.shape[0] - 1)
        evidence = ti.cast(ti.cast(modes[n + 1, 3], ti.i64) + bias, ti.f64)
        # Factors are powers of two: these products are exact.
        scores[n] = ti.cast(evidence * ti.cast(1 / UNIT, ti.f64), ti.f32)
        scales[n] = ti.cast(sizes[size, 0], ti.f32)
        for k in range(2):
            center = ti.cast(modes[n + 1, k], ti.f64) * ti.cast(1 / FINE, ti.f64)
            middle = center + 0.5
            boxes[n, k] = ti.cast(middle - sizes[size, k + 1], ti.f32)
            boxes[n, k + 2] = ti.cast(middle + sizes[size, k + 1], ti.f32)
            centers[n, k] = ti.cast(center, ti.f32)
