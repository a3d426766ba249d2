"""Detection of laser lines, one position in each column or row of a frame, in Warp.

The Taichi set has the equations. On the CPU a thread computes a slab of lines, and `find` reads the
frame row by row, in the order of memory. On CUDA a warp computes one line, or finds the brightest
windows of 32 columns in some of the rows.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.structured_light import LEAST_BEND, MOST_MOVES, MOST_OFFSET
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK, launch, launch_each, launch_slabs, slabs

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

MOVES = wp.constant(MOST_MOVES)
OFFSET = wp.constant(MOST_OFFSET)
LEAST = wp.constant(LEAST_BEND)
WARPS = 32  # warps of a block on CUDA, each with some of the rows of its 32 columns


def find(frames: wp.array, axis: int, half: int, places: wp.array) -> None:
    """Find the brightest window of each line, -1 where all is NaN."""
    lines = places.shape[1]
    if places.device.is_cuda:
        if axis == 0:
            blocks = places.shape[0] * -(-lines // 32)
            kernel = _find_in_columns_cuda(frames.dtype)
            launch(kernel, blocks * 32 * WARPS, [frames, half], [places], 32 * WARPS)
        else:
            kernel = _find_in_rows_cuda(frames.dtype)
            launch(kernel, _warps(places.size), [frames, half], [places], BLOCK)
        return
    parts = max(1, min(slabs(lines, frames.size), lines))
    launch_slabs(_find_cpu(frames.dtype), lines, parts, [frames, axis, half], [places])


def peaks(
    frames: wp.array, axis: int, places: wp.array, positions: wp.array, strengths: wp.array
) -> None:
    """Refine places, the first of equal values, by a parabola; the strength is the value there."""
    kernel = _kernels(frames.dtype).peaks
    launch_each(kernel, places.size, places.size, [frames, axis, places], [positions, strengths])


def centroids(
    frames: wp.array,
    axis: int,
    places: wp.array,
    radius: int,
    positions: wp.array,
    strengths: wp.array,
) -> None:
    """Refine places by the centre of mass of a window above its darkest pixel.

    The strength is the brightest value of the window less the darkest.
    """
    work = places.size * (2 * radius + 1)
    inputs = [frames, axis, places, radius]
    kernel = _kernels(frames.dtype).centroids
    launch_each(kernel, places.size, work, inputs, [positions, strengths])


def ridges(
    frames: wp.array,
    axis: int,
    places: wp.array,
    taps: wp.array,
    scale: float,
    curve: float,
    positions: wp.array,
    strengths: wp.array,
) -> None:
    """Refine places by Steger's rule; the strength is `scale` times the bend.

    `curve` is 1 over the variance of the smoothed profile.
    """
    inputs = [frames, axis, places, taps, scale, curve]
    if places.device.is_cuda:
        kernel = _find_ridges_cuda(frames.dtype)
        launch(kernel, _warps(places.size), inputs, [positions, strengths], BLOCK)
        return
    kernel = _kernels(frames.dtype).ridges
    work = places.size * taps.shape[1] ** 2
    launch_each(kernel, places.size, work, inputs, [positions, strengths])


def select(strengths: wp.array, threshold: float, positions: wp.array) -> None:
    """Make NaN of the positions of less strength than the threshold."""
    launch(_select, positions.shape, [strengths, threshold], [positions])


@wp.kernel
def _select(
    strengths: wp.array2d[float],
    threshold: float,
    # outputs
    positions: wp.array2d[float],
):
    n, line = wp.tid()
    if not strengths[n, line] >= threshold:
        positions[n, line] = wp.nan


@lru_cache
def _find_cpu(scalar: Any) -> wp.Kernel:
    @_native.func_native("_laser_cpu.h", TYPE=scalar)
    def find_lines(
        first: int,
        last: int,
        frames: wp.array3d[scalar],
        axis: int,
        half: int,
        places: wp.array2d[int],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def find_slab(
        slab: int,
        first: int,
        last: int,
        frames: wp.array3d[scalar],  # (N, H, W)
        axis: int,
        half: int,
        # outputs
        places: wp.array2d[int],  # (N, lines)
    ):
        find_lines(first, last, frames, axis, half, places)

    return find_slab


def _warps(lines: int) -> int:
    """Return the threads of a launch with a warp a line, in whole blocks."""
    return -(-32 * lines // BLOCK) * BLOCK


@lru_cache
def _find_in_columns_cuda(scalar: Any) -> wp.Kernel:
    @_native.kernel("_laser_cuda.cu", OPTIONS, TYPE=scalar, WARPS=WARPS)
    def find_in_columns(frames: wp.array3d[scalar], half: int, places: wp.array2d[int]): ...

    return find_in_columns


@lru_cache
def _find_in_rows_cuda(scalar: Any) -> wp.Kernel:
    @_native.kernel("_laser_cuda.cu", OPTIONS, TYPE=scalar)
    def find_in_rows(frames: wp.array3d[scalar], half: int, places: wp.array2d[int]): ...

    return find_in_rows


@lru_cache
def _find_ridges_cuda(scalar: Any) -> wp.Kernel:
    @_native.kernel(
        "_laser_cuda.cu",
        OPTIONS,
        TYPE=scalar,
        MOVES=MOST_MOVES,
        OFFSET=f"{MOST_OFFSET}f",
        LEAST=f"{LEAST_BEND}f",
    )
    def find_ridges(
        frames: wp.array3d[scalar],
        axis: int,
        places: wp.array2d[int],
        taps: wp.array2d[float],
        scale: float,
        curve: float,
        positions: wp.array2d[float],
        strengths: wp.array2d[float],
    ): ...

    return find_ridges


class _Kernels:
    """The kernels for frames of one dtype."""

    def __init__(self, scalar: Any):
        @wp.func
        def value(
            frames: wp.array3d[scalar], n: int, p: int, line: int, axis: int, size: int
        ) -> float:
            """Return the value at place `p` of a line; the ends are repeated."""
            at = wp.clamp(p, 0, size - 1)
            if axis == 0:
                return float(frames[n, at, line])
            return float(frames[n, line, at])

        @wp.kernel(module="unique", module_options=OPTIONS)
        def peaks(
            stride: int,
            first: int,
            last: int,
            frames: wp.array3d[scalar],
            axis: int,
            places: wp.array2d[int],
            # outputs
            positions: wp.array2d[float],
            strengths: wp.array2d[float],
        ):
            size = wp.where(axis == 0, frames.shape[1], frames.shape[2])
            for number in range(first + wp.tid(), last, stride):
                n = number // places.shape[1]
                line = number % places.shape[1]
                p = places[n, line]
                position = float(wp.nan)
                strength = float(0.0)
                if p >= 0:
                    a = value(frames, n, p - 1, line, axis, size)
                    b = value(frames, n, p, line, axis, size)
                    last = p
                    c = value(frames, n, last + 1, line, axis, size)
                    while last < size - 1 and c == b:
                        last += 1
                        c = value(frames, n, last + 1, line, axis, size)
                    bend = (b - a) + (b - c)
                    position = 0.5 * float(p + last)
                    if bend > 0.0:
                        position += 0.5 * ((c - a) / bend)
                    strength = b
                positions[n, line] = position
                strengths[n, line] = strength

        @wp.kernel(module="unique", module_options=OPTIONS)
        def centroids(
            stride: int,
            first: int,
            last: int,
            frames: wp.array3d[scalar],
            axis: int,
            places: wp.array2d[int],
            radius: int,
            # outputs
            positions: wp.array2d[float],
            strengths: wp.array2d[float],
        ):
            size = wp.where(axis == 0, frames.shape[1], frames.shape[2])
            for number in range(first + wp.tid(), last, stride):
                n = number // places.shape[1]
                line = number % places.shape[1]
                p = places[n, line]
                position = float(wp.nan)
                strength = float(0.0)
                if p >= 0:
                    begin = wp.max(0, p - radius)
                    end = wp.min(size - 1, p + radius)
                    floor = value(frames, n, begin, line, axis, size)
                    top = floor
                    for i in range(begin, end + 1):
                        v = value(frames, n, i, line, axis, size)
                        floor = wp.min(floor, v)
                        top = wp.max(top, v)
                    mass = float(0.0)
                    moment = float(0.0)
                    for i in range(begin, end + 1):
                        weight = value(frames, n, i, line, axis, size) - floor
                        mass += weight
                        moment += weight * float(i - p)
                    if mass > 0.0:
                        position = float(p) + moment / mass
                        strength = top - floor
                positions[n, line] = position
                strengths[n, line] = strength

        @wp.kernel(module="unique", module_options=OPTIONS)
        def ridges(
            stride: int,
            first: int,
            last: int,
            frames: wp.array3d[scalar],
            axis: int,
            places: wp.array2d[int],
            taps: wp.array2d[float],  # (3, 2 radius + 1): a Gaussian and its first two derivatives
            scale: float,
            curve: float,
            # outputs
            positions: wp.array2d[float],
            strengths: wp.array2d[float],
        ):
            size = wp.where(axis == 0, frames.shape[1], frames.shape[2])
            lines = places.shape[1]
            radius = taps.shape[1] // 2
            for number in range(first + wp.tid(), last, stride):
                n = number // lines
                line = number % lines
                p = places[n, line]
                position = float(wp.nan)
                strength = float(0.0)
                moves = int(0)
                while p >= 0 and moves < MOVES:
                    rp = float(0.0)
                    rl = float(0.0)
                    rpp = float(0.0)
                    rpl = float(0.0)
                    rll = float(0.0)
                    for i in range(-radius, radius + 1):
                        a0 = float(0.0)
                        a1 = float(0.0)
                        a2 = float(0.0)
                        for j in range(-radius, radius + 1):
                            beside = wp.clamp(line + j, 0, lines - 1)
                            v = value(frames, n, p + i, beside, axis, size)
                            a0 += v * taps[0, j + radius]
                            a1 += v * taps[1, j + radius]
                            a2 += v * taps[2, j + radius]
                        rp += a0 * taps[1, i + radius]
                        rl += a1 * taps[0, i + radius]
                        rpp += a0 * taps[2, i + radius]
                        rpl += a1 * taps[1, i + radius]
                        rll += a2 * taps[0, i + radius]
                    half = 0.5 * (rpp - rll)
                    if wp.abs(half) < LEAST:
                        half = 0.0
                    if wp.abs(rpl) < LEAST:
                        rpl = 0.0
                    spread = wp.sqrt(half * half + rpl * rpl)
                    least = 0.5 * (rpp + rll) - spread
                    tilt = float(0.0)
                    if half - spread < 0.0:
                        tilt = rpl / (half - spread)
                    moves += 1
                    if least < 0.0:
                        offset = -((rp + rl * tilt) / least)
                        if wp.abs(offset) <= OFFSET:
                            shorter = 1.0 - offset * offset * curve
                            position = float(p) + offset * shorter
                            strength = scale * -least
                            moves = MOVES
                        else:
                            step = wp.clamp(wp.floor(offset + 0.5), -1.0, 1.0)
                            p = wp.clamp(p + int(step), 0, size - 1)
                    else:
                        moves = MOVES
                positions[n, line] = position
                strengths[n, line] = strength

        self.peaks, self.centroids, self.ridges = peaks, centroids, ridges


@lru_cache
def _kernels(scalar: Any) -> _Kernels:
    return _Kernels(scalar)
