"""Figures of objects, from the masks of the patches that voted for them, in Warp."""

import math

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Space, Window
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._zeros import clear

from ._space import Cells, below, cells_of, factor_of, kernel_at, scaled

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FINE = wp.constant(codes.FINE)
FINE_BITS = wp.constant(codes.FINE_BITS)  # a shift rounds down, the quotient of Warp towards 0
SHARE_BITS = wp.constant(codes.SHARE_BITS)
KERNEL_BITS = wp.constant(wp.int64(codes.KERNEL_BITS))
WIDE = wp.constant(wp.int64(codes.FINE))
APART = wp.constant(codes.OCTAVE // 2)
LANES = 256  # threads of a mode on CUDA, which share the pixels of each patch
LANES_OF_ROW = 32  # threads of a row of a mask on CUDA
WORK = 1 << 17  # pixels of the patches of a mode, roughly: for the number of threads only


def paint_figures(
    votes: wp.array,
    sources: wp.array,
    starts: wp.array,
    space: Space,
    window: Window,
    places: wp.array,
    figures: wp.array,
    modes: wp.array,
    balance: wp.array,
) -> None:
    """Add up, for each of T modes, what its votes say of the pixels of their patches.

    `figures` (O, S S) have the share of the object in each pixel at each occurrence, in parts of
    255. A vote adds its weight in the kernel times (2 share - 1) to `balance` (T, H, W), the box
    of the object at scale 0 with a margin. Pixels are the nearest ones. Patches
    of another size, half an octave off, say nothing. One thread a mode.
    """
    clear(balance)
    lanes = LANES if balance.device.is_cuda else 1
    count, side = modes.shape[0], math.isqrt(figures.shape[1])
    cells = cells_of(votes, starts, space)
    reach = wp.vec2i(window.radius, window.scales)
    inputs = [lanes, cells, reach, sources, places, figures, side, modes]
    launch_each(_paint, count * lanes, count * WORK, inputs, [balance])


@wp.func
def paint_patch(
    balance: wp.array3d[int],
    figures: wp.array2d[wp.uint8],
    t: int,
    entry: int,
    side: int,
    first: wp.vec2i,
    weight: int,
    lane: int,
    lanes: int,
):
    """Add a weighted mask to the figure of a mode, at a first pixel."""
    for k in range(lane, side * side, lanes):
        down = k // side
        row = first[0] + down
        column = first[1] + k - down * side
        if row >= 0 and column >= 0 and row < balance.shape[1] and column < balance.shape[2]:
            product = weight * (2 * int(figures[entry, k]) - 255)
            wp.atomic_add(balance, t, row, column, product >> SHARE_BITS)


@wp.kernel
def _paint(
    stride: int,
    begin: int,
    end: int,
    lanes: int,
    cells: Cells,
    window: wp.vec2i,  # radius, in places and in scales
    sources: wp.array2d[int],  # (V, 2)
    places: wp.array2d[int],  # (N, 3)
    figures: wp.array2d[wp.uint8],  # (O, S S)
    side: int,
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    balance: wp.array3d[int],  # (T, H, W)
):
    height = int(balance.shape[1])
    width = int(balance.shape[2])
    for item in range(begin + wp.tid(), end, stride):
        t = item // lanes
        lane = item - t * lanes
        place = wp.vec3i(modes[t, 0], modes[t, 1], modes[t, 2])
        own = factor_of(cells.factors, cells.lowest, place[2])
        reach = scaled(window[0], own)
        scales = window[1]
        for s in range(cells.bins.shape[0]):
            if wp.abs(cells.bins[s, 3] - place[2]) <= scales + cells.slack:
                wide = cells.bins[s, 4]
                columns = cells.bins[s, 2]
                above = wp.max(place[0] - reach, 0) // wide
                last = wp.min((place[0] + reach) // wide + 1, cells.bins[s, 1])
                before = wp.min(wp.max(place[1] - reach, 0) // wide, columns)
                behind = wp.max(wp.min((place[1] + reach) // wide + 1, columns), before)
                for row in range(above, last):
                    cell = cells.bins[s, 0] + row * columns
                    for v in range(cells.starts[cell + before], cells.starts[cell + behind]):
                        other = wp.vec3i(cells.votes[v, 0], cells.votes[v, 1], cells.votes[v, 2])
                        near = kernel_at(other - place, reach, scales)
                        i = sources[v, 0]
                        if near > wp.int64(0) and wp.abs(places[i, 2] - place[2]) < APART:
                            weight = int(wp.int64(cells.votes[v, 3]) * near >> KERNEL_BITS)
                            # First pixel of the patch in the box, halves rounded up.
                            top = below(places[i, 0] - place[0], own) + FINE // 2
                            left = below(places[i, 1] - place[1], own) + FINE // 2
                            top += FINE * (height - side) // 2
                            left += FINE * (width - side) // 2
                            first = wp.vec2i(top >> FINE_BITS, left >> FINE_BITS)
                            paint_patch(
                                balance, figures, t, sources[v, 1], side, first, weight, lane, lanes
                            )


def spread_figures(balance: wp.array, modes: wp.array, space: Space, masks: wp.array) -> None:
    """Set the pixels of an image that are of the object of each mode; threads take rows.

    `masks` (T, H, W) are 1 where the balance, linear between its pixels, is above 0.
    """
    clear(masks)
    lanes = LANES_OF_ROW if masks.device.is_cuda else 1
    count = masks.shape[0] * masks.shape[1]
    inputs = [lanes, balance, modes, space.factors, space.lowest]
    launch_each(_spread, count * lanes, count * balance.shape[2], inputs, [masks])


@wp.func
def balance_at(balance: wp.array3d[int], t: int, row: int, column: int) -> wp.int64:
    """Return the balance of a pixel, 0 outside."""
    if row < 0 or column < 0 or row >= balance.shape[1] or column >= balance.shape[2]:
        return wp.int64(0)
    return wp.int64(balance[t, row, column])


@wp.kernel
def _spread(
    stride: int,
    begin: int,
    end: int,
    lanes: int,
    balance: wp.array3d[int],  # (T, H, W)
    modes: wp.array2d[int],  # (T, 4)
    factors: wp.array[int],
    lowest: int,
    # outputs
    masks: wp.array3d[wp.uint8],  # (T, H, W)
):
    height = int(balance.shape[1])
    width = int(balance.shape[2])
    for item in range(begin + wp.tid(), end, stride):
        line = item // lanes
        lane = item - line * lanes
        t = line // masks.shape[1]
        row = line - t * masks.shape[1]
        factor = factor_of(factors, lowest, modes[t, 2])
        y = below(FINE * row - modes[t, 0], factor) + FINE * (height - 1) // 2
        top = y >> FINE_BITS
        if top >= -1 and top < height:
            down = wp.int64(y - FINE * top)
            # The box, and some pixels more.
            half = scaled(FINE * (width + 3) // 2, factor)
            first = wp.max((modes[t, 1] - half) >> FINE_BITS, 0)
            last = wp.min(((modes[t, 1] + half) >> FINE_BITS) + 2, masks.shape[2])
            for column in range(first + lane, last, lanes):
                x = below(FINE * column - modes[t, 1], factor) + FINE * (width - 1) // 2
                left = x >> FINE_BITS
                along = wp.int64(x - FINE * left)
                upper = (WIDE - along) * balance_at(balance, t, top, left)
                upper += along * balance_at(balance, t, top, left + 1)
                lower = (WIDE - along) * balance_at(balance, t, top + 1, left)
                lower += along * balance_at(balance, t, top + 1, left + 1)
                if (WIDE - down) * upper + down * lower > wp.int64(0):
                    masks[t, row, column] = wp.uint8(1)
