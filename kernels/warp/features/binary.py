"""FAST corners and binary descriptors in Warp: all decisions in integers, but for one angle."""

import warp as wp

from cvkern.kernels.codes.features import DISC, PAIRS, TURNS, TURNS_PER_RADIAN
from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._zeros import clear

from . import _binary_cpu as cpu
from . import _binary_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RADIUS = wp.constant(DISC)
STEPS = wp.constant(TURNS)
PER_RADIAN = wp.constant(TURNS_PER_RADIAN)
BYTES = wp.constant(PAIRS // 8)


def round_values(src: wp.array, dst: wp.array) -> None:
    """Bytes of values: rounded and cut off; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.round_values, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.round_values, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def widen_values(src: wp.array, dst: wp.array) -> None:
    """Values of bytes; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.widen_values, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.widen_values, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def score_corners(src: wp.array, threshold: int, margin: int, scores: wp.array) -> None:
    """Score FAST corners of 9 pixels of 16; one thread a pixel."""
    height = src.shape[0]
    if src.device.is_cuda:
        launch(cuda.score, src.shape, [src, threshold, margin], [scores])
        return
    launch_slabs(cpu.score, height, slabs(height, src.size), [src, threshold, margin], [scores])


def mark_corners(scores: wp.array, words: wp.array) -> None:
    """Mark scores that are the largest of 3 x 3, of equal ones the first; one bit a pixel."""
    height = scores.shape[0]
    if scores.device.is_cuda:
        clear(words)
        launch(cuda.mark, scores.shape, [scores], [words])
        return
    launch_slabs(cpu.mark, height, slabs(height, scores.size), [scores], [words])


def weigh_corners(src: wp.array, points: wp.array, responses: wp.array) -> None:
    """Harris' measure over 7 x 7 pixels, times 25, as an integer; one thread a point."""
    count = points.shape[0]
    launch_each(_weigh, count, 500 * count, [src, points], [responses])


def describe_corners(
    src: wp.array,
    smooth: wp.array,
    points: wp.array,
    pattern: wp.array,
    upright: int,
    angles: wp.array,
    descriptors: wp.array,
) -> None:
    """Direction by the moments of a disc, bits by comparing pairs of pixels; a thread a point."""
    count = points.shape[0]
    inputs = [src, smooth, points, pattern, upright]
    launch_each(_describe, count, 1000 * count, inputs, [angles, descriptors])


@wp.kernel
def _weigh(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    points: wp.array2d[int],
    # outputs
    responses: wp.array[wp.int64],
):
    for n in range(first + wp.tid(), last, stride):
        yy = int(0)
        xx = int(0)
        xy = int(0)
        for y in range(points[n, 0] - 3, points[n, 0] + 4):
            for x in range(points[n, 1] - 3, points[n, 1] + 4):
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
