"""Figures of objects, from the masks of the patches that voted for them, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import (
    FINE,
    KERNEL_ONE,
    OCTAVE,
    SHARE_BITS,
    Space,
    Window,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.recognition.votes import _below, _factor, _kernel_at, _scaled, _span

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
vec3i = ti.types.vector(3, ti.i32)
i32_5 = ti.types.vector(5, ti.i32)


@primitive
def paint_figures(
    votes: np.ndarray,
    sources: np.ndarray,
    starts: np.ndarray,
    space: Space,
    window: Window,
    places: np.ndarray,
    figures: np.ndarray,
    modes: np.ndarray,
    balance: np.ndarray,
) -> None:
    """Add up, for each of T modes, what its votes say of the pixels of their patches.

    `figures` (O, S S) have the share of the object in each pixel at each occurrence, in parts of
    255. A vote adds its weight in the kernel times (2 share - 1) to `balance` (T, H, W), the box
    of the object at scale 0 with a margin. Pixels are the nearest ones. Patches
    of another size, half an octave off, say nothing. One thread a mode.
    """
    given = i32_5(space.slack, space.lowest, *window)
    _paint(
        votes, sources, starts, space.bins, space.factors, given, places, figures, modes, balance
    )


@ti.kernel
def _paint(
    votes: i32_2,  # (V, 4)
    sources: i32_2,  # (V, 2)
    starts: i32_1,
    bins: i32_2,
    factors: i32_1,
    given: i32_5,
    places: i32_2,  # (N, 3)
    figures: u8_2,
    modes: i32_2,  # (T, 4)
    # outputs
    balance: i32_3,  # (T, H, W)
):
    slack, lowest, radius, scales = given[0], given[1], given[2], given[3]
    for t in range(modes.shape[0]):
        height = balance.shape[1]
        width = balance.shape[2]
        for row, column in ti.ndrange(height, width):
            balance[t, row, column] = 0
        side = ti.cast(ti.sqrt(ti.cast(figures.shape[1], ti.f32)) + 0.5, ti.i32)
        y = modes[t, 0]
        x = modes[t, 1]
        z = modes[t, 2]
        own = _factor(factors, lowest, z)
        reach = _scaled(radius, own)
        for s in range(bins.shape[0]):
            if ti.abs(bins[s, 3] - z) <= scales + slack:
                above, below, before, behind = _span(bins, s, y, x, reach)
                for cells in range(above, below):
                    cell = bins[s, 0] + cells * bins[s, 2]
                    for v in range(starts[cell + before], starts[cell + behind]):
                        apart = vec3i(votes[v, 0] - y, votes[v, 1] - x, votes[v, 2] - z)
                        near = _kernel_at(apart, reach, scales)
                        i = sources[v, 0]
                        if near > 0 and ti.abs(places[i, 2] - z) < OCTAVE // 2:
                            weight = ti.cast(votes[v, 3] * near // KERNEL_ONE, ti.i32)
                            # First pixel of the patch in the box, in parts of a pixel.
                            top = _below(places[i, 0] - y, own) + FINE * (height - side) // 2
                            left = _below(places[i, 1] - x, own) + FINE * (width - side) // 2
                            first = (top + FINE // 2) // FINE
                            begin = (left + FINE // 2) // FINE
                            for k in range(figures.shape[1]):
                                row = first + k // side
                                column = begin + k % side
                                if 0 <= row < height and 0 <= column < width:
                                    share = ti.cast(figures[sources[v, 1], k], ti.i32)
                                    product = weight * (2 * share - 255)
                                    balance[t, row, column] += product >> SHARE_BITS


@primitive
def spread_figures(balance: np.ndarray, modes: np.ndarray, space: Space, masks: np.ndarray) -> None:
    """Set the pixels of an image that are of the object of each mode; a thread a pixel.

    `masks` (T, H, W) are 1 where the balance, linear between its pixels, is above 0.
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
        factor = _factor(factors, lowest, modes[t, 2])
        y = _below(FINE * row - modes[t, 0], factor) + FINE * (balance.shape[1] - 1) // 2
        x = _below(FINE * column - modes[t, 1], factor) + FINE * (balance.shape[2] - 1) // 2
        top = y // FINE
        left = x // FINE
        down = y - FINE * top
        along = x - FINE * left
        upper = (FINE - along) * _at(balance, t, top, left) + along * _at(balance, t, top, left + 1)
        lower = (FINE - along) * _at(balance, t, top + 1, left) + along * _at(
            balance, t, top + 1, left + 1
        )
        masks[t, row, column] = ti.cast((FINE - down) * upper + down * lower > 0, ti.u8)
