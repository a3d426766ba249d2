"""Figures of objects, from the masks of the patches that voted for them, in Warp."""

import math

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Frame, Occurrences, Patches, Space, Window
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._zeros import clear

from . import _figures_cpu as cpu
from ._space import (
    Ballot,
    active_words,
    ballot_of,
    below,
    bin_of,
    cell_of,
    factor_of,
    first_from,
    kernel_at,
    scaled,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FINE = wp.constant(codes.FINE)
FINE_BITS = wp.constant(codes.FINE_BITS)  # a shift rounds down, the quotient of Warp towards 0
SHARE_BITS = wp.constant(codes.SHARE_BITS)
KERNEL_BITS = wp.constant(wp.int64(codes.KERNEL_BITS))
WIDE = wp.constant(wp.int64(codes.FINE))
APART = wp.constant(codes.OCTAVE // 2)
LANES = wp.constant(32)  # threads of a warp on CUDA, which share the pixels of each patch
PARTS = wp.constant(16)  # warps of a row of patches and a mode
LANES_OF_ROW = 32  # threads of a row of a mask on CUDA
WORK = 1 << 17  # pixels of the patches of a mode, roughly: for the number of threads only


def paint_figures(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    window: Window,
    frame: Frame,
    figures: wp.array,
    modes: wp.array,
    balance: wp.array,
) -> None:
    """Add up, for each of T modes, what its votes say of the pixels of their patches.

    `figures` (O, S S) have the share of the object in each pixel at each occurrence, in parts of
    255. A vote adds its weight in the kernel times (2 share - 1) to `balance` (T, H, W), the box
    of the object at scale 0 with a margin. Pixels are the nearest ones. Patches of another size,
    half an octave off, say nothing, nor those whose middle is farther from the mode than the box
    at their own size and the radius of the kernel.
    """
    clear(balance)
    count, side = modes.shape[0], math.isqrt(figures.shape[1])
    ballot = ballot_of(patches, occurrences, space, 0, occurrences.starts)
    by = cpu.Painter()
    by.radius, by.scales, by.side = window.radius, window.scales, side
    by.half_height, by.half_width = frame.box_height, frame.box_width
    inputs = [ballot, by, figures, modes]
    if balance.device.is_cuda:
        threads = count * patches.rows.shape[0] * PARTS * LANES
        launch(_paint, threads, inputs, [balance])
        return
    launch_slabs(cpu.paint, count, slabs(count, count * WORK), inputs, [balance])


@wp.func
def near_mode(
    ballot: Ballot, by: cpu.Painter, e: int, place: wp.vec3i, mode: wp.vec3i, reach: int
) -> wp.int64:
    """Return the kernel at the vote of an occurrence, at most 0 where it does not count."""
    factor = factor_of(ballot.factors, ballot.lowest, place[2])
    other = wp.vec3i(
        place[0] + scaled(ballot.entries[e, 0], factor),
        place[1] + scaled(ballot.entries[e, 1], factor),
        place[2] + ballot.entries[e, 2],
    )
    apart = other - mode
    near = wp.int64(0)
    # Most votes are far away: find that without a division.
    if wp.abs(apart[0]) < reach and wp.abs(apart[1]) < reach and wp.abs(apart[2]) < by.scales:
        near = kernel_at(apart, reach, by.scales)
    if near > wp.int64(0):
        s = bin_of(ballot.bins, other[2], ballot.slack)
        if cell_of(ballot.bins, s, other[0], other[1]) < 0:
            near = wp.int64(0)
    return near


@wp.kernel
def _paint(
    ballot: Ballot,
    by: cpu.Painter,
    figures: wp.array2d[wp.uint8],  # (O, S S)
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    balance: wp.array3d[int],  # (T, H, W)
):
    # A warp has every `PARTS`-th patch of a row for a mode; a lane has every 32nd pixel.
    item = wp.tid() // LANES
    lane = wp.tid() - item * LANES
    part = item % PARTS
    line = item // PARTS
    rows = ballot.rows.shape[0]
    t = line // rows
    row = line - t * rows
    mode = wp.vec3i(modes[t, 0], modes[t, 1], modes[t, 2])
    begin = ballot.rows[row, 1]
    end = ballot.rows[row, 2]
    scale = ballot.places[begin, 2]
    factor = factor_of(ballot.factors, ballot.lowest, scale)
    own = factor_of(ballot.factors, ballot.lowest, mode[2])
    reach = scaled(by.radius, own)
    if wp.abs(scale - mode[2]) >= APART:
        return
    if wp.abs(ballot.rows[row, 0] - mode[0]) > scaled(by.half_height, factor) + reach:
        return
    along = scaled(by.half_width, factor) + reach
    height = int(balance.shape[1])
    width = int(balance.shape[2])
    side = by.side
    first = first_from(ballot.places, begin, end, mode[1] - along)
    for i in range(first + part, first_from(ballot.places, first, end, mode[1] + along + 1), PARTS):
        place = wp.vec3i(ballot.places[i, 0], ballot.places[i, 1], scale)
        # First pixel of the patch in the box, halves rounded up.
        top = below(place[0] - mode[0], own) + FINE // 2 + FINE * (height - side) // 2
        left = below(place[1] - mode[1], own) + FINE // 2 + FINE * (width - side) // 2
        top = top >> FINE_BITS
        left = left >> FINE_BITS
        active = active_words(ballot.matches, i)
        for m in range(active):
            word = ballot.matches[i, m]
            for e in range(ballot.begins[word], ballot.begins[word + 1]):
                near = near_mode(ballot, by, e, place, mode, reach)
                if near > wp.int64(0):
                    weight = int(wp.int64(ballot.entries[e, 3] // active) * near >> KERNEL_BITS)
                    for k in range(lane, side * side, LANES):
                        down = k // side
                        column = left + k - down * side
                        down += top
                        if down >= 0 and column >= 0 and down < height and column < width:
                            product = weight * (2 * int(figures[e, k]) - 255)
                            wp.atomic_add(balance, t, down, column, product >> SHARE_BITS)


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
