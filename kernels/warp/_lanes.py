"""Lanes: a row of pixels seen as vectors, which is what makes Warp fast on the CPU.

A vector starts at every pixel (the views overlap), so ``row[x + t]`` is the vector t pixels on.
Arithmetic on a vector, and a loop over its elements, become SIMD instructions.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from ._launch import scratch

LANES = 32
f32_lanes = wp.types.vector(LANES, wp.float32)
i32_lanes = wp.types.vector(LANES, wp.int32)
u8_lanes = wp.types.vector(LANES, wp.uint8)


def vectors(array: wp.array, dtype: Any) -> wp.array:
    """View a contiguous array of at least LANES columns as the vectors that start at each pixel."""
    return wp.array(
        ptr=array.ptr,
        dtype=dtype,
        shape=(*array.shape[:-1], array.shape[-1] - LANES + 1),
        strides=array.strides,
        device=array.device,
    )


def padded(array: wp.array, name: str) -> wp.array:
    """Return a 2-D `array`, copied to scratch rows of LANES columns if it has fewer."""
    rows, columns = array.shape
    if columns >= LANES:
        return array
    wide = scratch(name, (rows, LANES), array.dtype, array.device)
    wide.numpy()[:, :columns] = array.numpy()
    return wide


def unpad(wide: wp.array, array: wp.array) -> None:
    """Copy the columns of `array` back from what :func:`padded` made of it."""
    if wide is not array:
        array.numpy()[...] = wide.numpy()[:, : array.shape[1]]
