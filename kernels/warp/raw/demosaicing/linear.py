"""Demosaicing by fixed filters, in Warp: 128 pixels at once on the CPU, blocks of 16 on CUDA.

Bilinear means of integers have kernels of their own on the CPU. The Taichi set states the filters.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.raw import Linear
from cvkern.kernels.warp._launch import launch_slabs, slabs
from cvkern.kernels.warp._spans import Spans, spans
from cvkern.kernels.warp.raw._types import constants
from cvkern.kernels.warp.raw.demosaicing import _linear_cuda
from cvkern.kernels.warp.raw.demosaicing._bilinear_cpu import averages


def interpolate(
    raw: wp.array, red_row: int, red_column: int, method: int, colours: wp.array
) -> None:
    """Fill in the two colours that each pixel misses; red is at (red_row, red_column)."""
    if raw.device.is_cuda:
        _linear_cuda.interpolate(raw, red_row, red_column, method, colours)
        return
    height, width = raw.shape
    inputs = [raw, red_row, red_column]
    if method == Linear.BILINEAR and raw.dtype in averages:
        launch_slabs(averages[raw.dtype], height, slabs(height, 3 * raw.size), inputs, [colours])
        return
    _kernels(raw.dtype, method).launch(height, width, 3 * raw.size, inputs, [colours])


@lru_cache
def _kernels(scalar: Any, method: int) -> Spans:
    @spans("_linear.h", SHARP=int(method == Linear.MALVAR), **constants(scalar))
    def interpolate(
        row: int,
        left: int,
        right: int,
        raw: wp.array2d[scalar],
        red_row: int,
        red_column: int,
        colours: wp.array3d[scalar],
    ): ...

    return interpolate
