"""Extrema of a scale space on CUDA. The Taichi set has the rule.

A thread takes a pixel; in `mark` a warp takes 30 columns, and goes down the rows. Its code
(_extrema_cuda.cu) is native, because a warp's lanes exchange what they load.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.features import GRAY, MOST_GRAY, MOVES
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Blocks are numbered along one axis.
_OPTIONS = {"enable_backward": False, "fuse_fp": False, "default_grid_stride": False}
ROWS = 16  # rows that a warp goes down
COLUMNS = 30  # columns of a warp; its outer lanes have those beside them
MOVING = 1 << 16  # threads that move extrema
BLOCK = 128  # threads of a block that marks
REGISTERS = (BLOCK, 6)  # six blocks per multiprocessor: 80 registers a thread
BRIGHTEST = wp.constant(MOST_GRAY)
RED, GREEN, BLUE = (wp.constant(w) for w in GRAY)


def _gray(scalar: Any) -> wp.Kernel:
    """Return the kernel for photographs of `scalar`."""

    @wp.kernel
    def gray(
        src: wp.array3d[scalar],  # (H, W, C)
        scale: float,
        # outputs
        dst: wp.array2d[float],  # (H, W)
    ):
        y, x = wp.tid()
        v = float(src[y, x, 0])
        if src.shape[2] > 1:
            v = RED * v + GREEN * float(src[y, x, 1]) + BLUE * float(src[y, x, 2])
        v = v * scale
        if not (wp.abs(v) <= BRIGHTEST):  # NaN as well
            v = 0.0
        dst[y, x] = v

    return gray


grays = {scalar: _gray(scalar) for scalar in (wp.float32, wp.uint8)}


@wp.kernel
def double(
    src: wp.array2d[float],  # (H, W)
    # outputs
    dst: wp.array2d[float],  # (2 H, 2 W)
):
    y, x = wp.tid()
    below = wp.min(y + 1, src.shape[0] - 1)
    right = wp.min(x + 1, src.shape[1] - 1)
    here = src[y, x]
    beside = src[y, right]
    left = 0.5 * (here + src[below, x])
    dst[2 * y, 2 * x] = here
    dst[2 * y, 2 * x + 1] = 0.5 * (here + beside)
    dst[2 * y + 1, 2 * x] = left
    dst[2 * y + 1, 2 * x + 1] = 0.5 * (left + 0.5 * (beside + src[below, right]))


@lru_cache
def mark(levels: int) -> wp.Kernel:
    """Return the kernel for octaves with so many inner levels."""

    @_native.kernel(
        "_extrema_cuda.cu",
        _OPTIONS,
        launch_bounds=REGISTERS,
        COLUMNS=COLUMNS,
        LEVELS=levels,
        ROWS=ROWS,
        MOVES=MOVES,
    )
    def mark(
        octaves: wp.array2d[wp.int64],  # (O, 4)
        threshold: float,
        margin: int,
        # outputs
        queue: wp.array2d[int],  # (Q, 4)
        number: wp.array[int],  # cleared
    ): ...

    return mark


@_native.kernel("_extrema_cuda.cu", _OPTIONS, MOVES=MOVES)
def move(
    octaves: wp.array2d[wp.int64],
    threshold: float,
    contrast: float,
    edge: float,
    margin: int,
    queue: wp.array2d[int],
    number: wp.array[int],
    # outputs, cleared
    words: wp.array[int],
    counts: wp.array[int],  # (rows,)
): ...


def threads(octaves: Sequence[wp.array], margin: int) -> int:
    """Return the threads of a launch of `mark`: a warp for 30 columns of `ROWS` rows."""
    inner = ([max(side - 2 * margin, 0) for side in octave.shape[1:]] for octave in octaves)
    warps = sum(-(-height // ROWS) * -(-width // COLUMNS) for height, width in inner)
    return -(-warps * 32 // BLOCK) * BLOCK
