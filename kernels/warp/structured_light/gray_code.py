"""Decoding of Gray codes in photographs of a projector's patterns, in Warp.

The Taichi set has the equation. All frames of a pixel are read once. On the CPU a thread decodes a
slab of rows, one row at a time; on CUDA it decodes eight neighbouring pixels, of bytes four.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.structured_light import NONE
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

wp.set_module_options({"enable_backward": False})

_QUAD = 8  # pixels of a thread on CUDA
_AHEAD = 6  # bits whose frames are read at once there, of bytes


def decode(
    frames: wp.array,
    begin: int,
    bits: int,
    size: int,
    margin: float,
    joins: bool,
    codes: wp.array,
    valid: wp.array,
) -> None:
    """Decode the pairs of frames of an axis of `size` lines, from `begin` on.

    `valid` tells which pixels have a code; with `joins`, only those that were valid before.
    """
    inputs, outputs = [frames, begin, bits, size, margin, joins], [codes, valid]
    if codes.device.is_cuda:
        packed = frames.dtype is wp.uint8 and bits <= 16
        kernel = _decode_bytes_cuda() if packed else _decode_cuda(frames.dtype)
        launch(kernel, -(-codes.size // (4 if packed else _QUAD)), inputs, outputs)
        return
    height = codes.shape[0]
    launch_slabs(
        _decode_cpu(frames.dtype), height, slabs(height, 2 * bits * codes.size), inputs, outputs
    )


def accept(white: wp.array, black: wp.array, contrast: float, valid: wp.array) -> None:
    """Clear the pixels without enough light.

    One thread a slab of rows on the CPU, four pixels on CUDA.
    """
    inputs, height = [white, black, contrast], valid.shape[0]
    if valid.device.is_cuda:
        launch(_accept_cuda(white.dtype), -(-valid.size // 4), inputs, [valid])
        return
    launch_slabs(_accept_cpu(white.dtype), height, slabs(height, valid.size), inputs, [valid])


def spreads(frames: wp.array, begin: int, step: int, spreads: wp.array) -> None:
    """Compare the sums of consecutive pairs, at every `step`-th pixel down and across.

    A pattern and its inverse add up to the same light, so that the sums differ by noise alone. One
    thread a comparison.
    """
    launch(_spreads(frames.dtype), spreads.shape, [frames, begin, step], [spreads])


@lru_cache
def _decode_cpu(scalar: Any) -> wp.Kernel:
    @_native.func_native("_gray_code_cpu.h", TYPE=scalar, NONE=NONE)
    def decode_row(
        row: int,
        frames: wp.array3d[scalar],
        begin: int,
        bits: int,
        size: int,
        margin: float,
        joins: bool,
        codes: wp.array2d[int],
        valid: wp.array2d[wp.uint8],
    ): ...

    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def decode_slab(
        slab: int,
        first: int,
        last: int,
        frames: wp.array3d[scalar],  # (K, H, W)
        begin: int,
        bits: int,
        size: int,
        margin: float,
        joins: bool,
        # outputs
        codes: wp.array2d[int],
        valid: wp.array2d[wp.uint8],
    ):
        for row in range(first, last):
            decode_row(row, frames, begin, bits, size, margin, joins, codes, valid)

    return decode_slab


@lru_cache
def _decode_cuda(scalar: Any) -> wp.Kernel:
    @_native.kernel(
        "_gray_code_cuda.cu",
        {"enable_backward": False},
        TYPE=scalar,
        NONE=NONE,
        QUAD=_QUAD,
    )
    def decode_quad(
        frames: wp.array3d[scalar],
        begin: int,
        bits: int,
        size: int,
        margin: float,
        joins: bool,
        codes: wp.array2d[int],
        valid: wp.array2d[wp.uint8],
    ): ...

    return decode_quad


@lru_cache
def _decode_bytes_cuda() -> wp.Kernel:
    @_native.kernel("_gray_code_cuda.cu", {"enable_backward": False}, NONE=NONE, AHEAD=_AHEAD)
    def decode_bytes(
        frames: wp.array3d[wp.uint8],
        begin: int,
        bits: int,
        size: int,
        margin: float,
        joins: bool,
        codes: wp.array2d[int],
        valid: wp.array2d[wp.uint8],
    ): ...

    return decode_bytes


@lru_cache
def _accept_cpu(scalar: Any) -> wp.Kernel:
    @_native.func_native("_gray_code_cpu.h", TYPE=scalar)
    def accept_row(
        row: int,
        white: wp.array2d[scalar],
        black: wp.array2d[scalar],
        contrast: float,
        valid: wp.array2d[wp.uint8],
    ): ...

    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def accept_slab(
        slab: int,
        first: int,
        last: int,
        white: wp.array2d[scalar],  # (H, W)
        black: wp.array2d[scalar],
        contrast: float,
        # outputs
        valid: wp.array2d[wp.uint8],
    ):
        for row in range(first, last):
            accept_row(row, white, black, contrast, valid)

    return accept_slab


@lru_cache
def _accept_cuda(scalar: Any) -> wp.Kernel:
    @_native.kernel("_gray_code_cuda.cu", {"enable_backward": False}, TYPE=scalar)
    def accept_four(
        white: wp.array2d[scalar],  # (H, W)
        black: wp.array2d[scalar],
        contrast: float,
        valid: wp.array2d[wp.uint8],
    ): ...

    return accept_four


@lru_cache
def _spreads(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def compare_sums(
        frames: wp.array3d[scalar],  # (K, H, W)
        begin: int,
        step: int,
        # outputs
        spreads: wp.array2d[float],  # (samples, bits - 1)
    ):
        i, k = wp.tid()
        across = (frames.shape[2] + step - 1) // step
        y = i // across * step
        x = i % across * step
        at = begin + 2 * k
        first = float(frames[at, y, x]) + float(frames[at + 1, y, x])
        second = float(frames[at + 2, y, x]) + float(frames[at + 3, y, x])
        spreads[i, k] = wp.abs(second - first)

    return compare_sums
