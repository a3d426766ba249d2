"""FAST corners and binary descriptors, in Warp.

The Taichi set has the rules. On the CPU a thread takes a slab of rows or of corners
(_binary_cpu.h). On CUDA it takes a pixel to find corners (_binary_cuda.py), or a corner to measure
and describe it.
"""

import warp as wp

from cvkern.kernels.codes.features import DISC, PAIRS, TURNS, TURNS_PER_RADIAN
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._zeros import clear
from cvkern.kernels.warp.filters.linear import correlate_separable

from . import _binary_cpu as cpu
from . import _binary_cuda as cuda
from .keypoints.extrema import count_marks, list_marks

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RADIUS = wp.constant(DISC)
STEPS = wp.constant(TURNS)
PER_RADIAN = wp.constant(TURNS_PER_RADIAN)
BYTES = wp.constant(PAIRS // 8)
SCORES = 64  # pixels whose scores the CPU finds at once


def round_values(src: wp.array, dst: wp.array) -> None:
    """Bytes of values: rounded and cut off; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.round_values, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.round_values, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def mark_corners(
    src: wp.array, threshold: int, margin: int, words: wp.array, counts: wp.array
) -> None:
    """Mark FAST corners of 9 pixels of 16 that score most of 3 x 3, of equal ones the first.

    A bit a pixel, and their number in each row.
    """
    height, width = src.shape
    if src.device.is_cuda:
        scores = scratch("corners.scores", src.shape, wp.uint8, src.device)
        launch(cuda.score, src.shape, [src, threshold, margin], [scores])
        clear(words)
        launch(cuda.mark, src.shape, [scores], [words])
        count_marks(words, counts)
        return
    parts = slabs(height, src.size)
    pitch = (-(-width // SCORES) + 2) * SCORES
    lines = scratch("corners.lines", (3 * parts, pitch), wp.uint8, src.device)
    launch_slabs(cpu.mark, height, parts, [src, threshold, margin, lines], [words, counts])


def list_corners(
    src: wp.array, words: wp.array, starts: wp.array, places: wp.array, responses: wp.array
) -> None:
    """List the places (row times width plus column) of the bits, with Harris' measure of each.

    It is that over 7 x 7 pixels, times 25, as an integer.
    """
    count = places.shape[0]
    if src.device.is_cuda:
        list_marks(words, starts, src.shape[1], places)
        launch_each(_weigh, count, 500 * count, [src, places], [responses])
        return
    height = src.shape[0]
    parts = slabs(height, 100 * count)
    launch_slabs(cpu.gather, height, parts, [src, words, starts], [places, responses])


def describe_corners(
    src: wp.array,
    taps: wp.array,
    points: wp.array,
    pattern: wp.array,
    upright: int,
    angles: wp.array,
    descriptors: wp.array,
) -> None:
    """Direction by the moments of a disc, bits by comparing pairs of smoothed pixels.

    A thread a point. The image is smoothed by `taps`; on the CPU the windows of the points are.
    """
    count = points.shape[0]
    if not src.device.is_cuda:
        inputs = [src, taps, points, pattern, upright]
        launch_slabs(cpu.describe, count, slabs(count, 4000 * count), inputs, [angles, descriptors])
        return
    planes = (1, *src.shape)
    real, smooth = (
        scratch(f"corners.{name}", planes, wp.float32, src.device) for name in ("real", "smooth")
    )
    launch(cuda.widen_values, src.shape, [src], [view(real, wp.float32, src.shape)])
    correlate_separable(real, taps, taps, 1, int(Border.MIRROR), 0.0, smooth)
    inputs = [src, view(smooth, wp.float32, src.shape), points, pattern, upright]
    launch_each(_describe, count, 1000 * count, inputs, [angles, descriptors])


@wp.kernel
def _weigh(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    places: wp.array[int],
    # outputs
    responses: wp.array[wp.int64],
):
    for n in range(first + wp.tid(), last, stride):
        row = places[n] // src.shape[1]
        column = places[n] - row * src.shape[1]
        yy = int(0)
        xx = int(0)
        xy = int(0)
        for y in range(row - 3, row + 4):
            for x in range(column - 3, column + 4):
                nw = int(src[y - 1, x - 1])
                ne = int(src[y - 1, x + 1])
                sw = int(src[y + 1, x - 1])
                se = int(src[y + 1, x + 1])
                gy = sw - nw + se - ne + 2 * (int(src[y + 1, x]) - int(src[y - 1, x]))
                gx = ne - nw + se - sw + 2 * (int(src[y, x + 1]) - int(src[y, x - 1]))
                yy += gy * gy
                xx += gx * gx
                xy += gx * gy
        det = wp.int64(yy) * wp.int64(xx) - wp.int64(xy) * wp.int64(xy)
        trace = wp.int64(yy) + wp.int64(xx)
        responses[n] = wp.int64(25) * det - trace * trace


@wp.kernel
def _describe(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    smooth: wp.array2d[float],
    points: wp.array2d[int],
    pattern: wp.array3d[int],  # (TURNS, PAIRS, 4): row, column, row, column
    upright: int,
    # outputs
    angles: wp.array[float],
    descriptors: wp.array2d[wp.uint8],
):
    for n in range(first + wp.tid(), last, stride):
        cy = points[n, 0]
        cx = points[n, 1]
        angle = float(0.0)
        turn = int(0)
        if upright == 0:
            down = int(0)
            along = int(0)
            for i in range(-RADIUS, RADIUS + 1):
                for j in range(-RADIUS, RADIUS + 1):
                    if i * i + j * j <= RADIUS * (RADIUS + 1):
                        v = int(src[cy + i, cx + j])
                        down += i * v
                        along += j * v
            angle = atan2(float(down), float(along))
            turn = int(wp.floor(angle * PER_RADIAN + 0.5)) & (STEPS - 1)
        angles[n] = angle
        for b in range(BYTES):
            bits = int(0)
            for k in range(8):
                p = 8 * b + k
                one = smooth[cy + pattern[turn, p, 0], cx + pattern[turn, p, 1]]
                other = smooth[cy + pattern[turn, p, 2], cx + pattern[turn, p, 3]]
                if one < other:
                    bits = bits | (1 << k)
            descriptors[n, b] = wp.uint8(bits)
