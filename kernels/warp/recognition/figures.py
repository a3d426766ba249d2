"""Figures of objects, from the masks of the patches that voted for them, in Warp."""

import math

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Frame, Occurrences, Patches, Space, Window
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._zeros import clear

from . import _figures_cpu as cpu
from . import _figures_cuda as cuda
from ._space import Painter, ballot_of, below, factor_of, scaled

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FINE = wp.constant(codes.FINE)
FINE_BITS = wp.constant(codes.FINE_BITS)  # a shift rounds down, the quotient of Warp towards 0
WIDE = wp.constant(wp.int64(codes.FINE))
UNIT = wp.constant(wp.float64(codes.UNIT))
ONE_PIXEL, HALF_PIXEL = wp.constant(wp.float64(codes.FINE)), wp.constant(wp.float64(0.5))
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
    """Add up the evidence of the votes for each of the first T modes, pixel by pixel.

    The first row of `modes` (R + 1, 4) is their number, then come their rows, columns and scales.
    `figures` (O, S S) have the share of the object in each pixel at each occurrence, in parts of
    255. A vote adds its weight in the kernel times (2 share - 1) to `balance` (T, H, W), the box
    of the object at scale 0 with a margin. Pixels are the nearest ones. Two kinds of
    patches are left out: those whose size differs by half an octave, and those whose middle is
    farther from the mode than the box at their own size and the radius of the kernel.
    """
    clear(balance)
    count, side = balance.shape[0], math.isqrt(figures.shape[1])
    ballot = ballot_of(patches, occurrences, space, 0, occurrences.starts)
    by = Painter()
    by.radius, by.scales, by.side = window.radius, window.scales, side
    by.half_height, by.half_width = frame.box_height, frame.box_width
    inputs = [ballot, by, figures, modes]
    if balance.device.is_cuda:
        launch(cuda.paint, count * patches.rows.shape[0] * cuda.PARTS * 32, inputs, [balance])
        return
    launch_slabs(cpu.paint, count, slabs(count, count * WORK), inputs, [balance])


def spread_figures(balance: wp.array, modes: wp.array, space: Space, masks: wp.array) -> None:
    """Set the pixels of an image that are of the object of each mode; threads take rows.

    `modes` are those of :func:`paint_figures`. `masks` (T, H, W) are 1 where the balance, linear
    between its pixels, is above 0.
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
        factor = factor_of(factors, lowest, modes[t + 1, 2])
        y = below(FINE * row - modes[t + 1, 0], factor) + FINE * (height - 1) // 2
        top = y >> FINE_BITS
        if top >= -1 and top < height:
            down = wp.int64(y - FINE * top)
            # The box, and some pixels more.
            half = scaled(FINE * (width + 3) // 2, factor)
            middle = modes[t + 1, 1]
            first = wp.max((middle - half) >> FINE_BITS, 0)
            last = wp.min(((middle + half) >> FINE_BITS) + 2, masks.shape[2])
            for column in range(first + lane, last, lanes):
                x = below(FINE * column - middle, factor) + FINE * (width - 1) // 2
                left = x >> FINE_BITS
                along = wp.int64(x - FINE * left)
                upper = (WIDE - along) * balance_at(balance, t, top, left)
                upper += along * balance_at(balance, t, top, left + 1)
                lower = (WIDE - along) * balance_at(balance, t, top + 1, left)
                lower += along * balance_at(balance, t, top + 1, left + 1)
                if (WIDE - down) * upper + down * lower > wp.int64(0):
                    masks[t, row, column] = wp.uint8(1)


def describe_objects(
    modes: wp.array,
    sizes: wp.array,
    lowest: int,
    bias: int,
    boxes: wp.array,
    scores: wp.array,
    centers: wp.array,
    scales: wp.array,
) -> None:
    """Describe N objects in pixels and in float32: their boxes, scores, centers and scales.

    `modes` are those of :func:`paint_figures`, with the evidence of each. `sizes` (F, 3) float64
    are the scale, half the height and half the width of a box at each scale from `lowest` on.
    `bias` is added to the evidence, which is in parts of `UNIT`.
    """
    count = scores.shape[0]
    launch_each(_describe, count, count, [modes, sizes, lowest, bias],
                [boxes, scores, centers, scales])  # fmt: skip


@wp.kernel
def _describe(
    stride: int,
    begin: int,
    end: int,
    modes: wp.array2d[int],  # (R + 1, 4)
    sizes: wp.array2d[wp.float64],  # (F, 3)
    lowest: int,
    bias: int,
    # outputs
    boxes: wp.array2d[float],  # (N, 4)
    scores: wp.array[float],
    centers: wp.array2d[float],  # (N, 2)
    scales: wp.array[float],
):
    for n in range(begin + wp.tid(), end, stride):
        size = wp.clamp(modes[n + 1, 2] - lowest, 0, sizes.shape[0] - 1)
        evidence = wp.int64(modes[n + 1, 3]) + wp.int64(bias)
        scores[n] = float(wp.float64(evidence) / UNIT)
        scales[n] = float(sizes[size, 0])
        for k in range(2):
            center = wp.float64(modes[n + 1, k]) / ONE_PIXEL
            middle = center + HALF_PIXEL
            boxes[n, k] = float(middle - sizes[size, k + 1])
            boxes[n, k + 2] = float(middle + sizes[size, k + 1])
            centers[n, k] = float(center)
