"""Lanes: a row of pixels viewed as vectors, which makes Warp fast on the CPU.

A vector starts at every pixel (the views overlap), so ``row[x + t]`` is the vector that begins t
pixels further. Arithmetic on a vector, and a loop over its elements, become SIMD instructions.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from ._replays import spoil
from ._scratch import scratch, view

# 16 SIMD registers of 8 floats (AVX2) hold two sums of 32 floats and their summands, or one sum of
# 64. Down the columns, two rows share the pixels that they read; along a row, nothing is shared.
LANES = 32
WIDE = 64
f32_lanes = wp.types.vector(LANES, wp.float32)
f32_wide = wp.types.vector(WIDE, wp.float32)


def vectors(array: wp.array, dtype: Any) -> wp.array:
    """View a contiguous array as the vectors of `dtype` that start at each pixel of its rows."""
    shape = (*array.shape[:-1], array.shape[-1] - dtype._length_ + 1)
    return view(array, dtype, shape, array.strides)


def padded(array: wp.array, name: str, width: int = LANES) -> wp.array:
    """Return a 2-D `array`, copied to scratch rows of `width` columns if it has fewer."""
    rows, columns = array.shape
    if columns >= width:
        return array
    spoil()
    wide = scratch(name, (rows, width), array.dtype, array.device)
    wide.numpy()[:, :columns] = array.numpy()
    return wide


def unpad(wide: wp.array, array: wp.array) -> None:
    """Copy the columns of `array` back from `wide`, the result of :func:`padded`."""
    if wide is not array:
        array.numpy()[...] = wide.numpy()[:, : array.shape[1]]
