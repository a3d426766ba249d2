"""Rank filters in Warp: one thread per slab of rows, or per element on CUDA.

The value of rank r is the largest v with at most r window values below v. Floats are compared as
integers: by their bits, in reversed order for negative ones.
"""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import WIDE, padded, vectors
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._structs import struct_of

from . import _medians_cpu as cpu
from . import _medians_cuda as cuda


def median(
    src: wp.array,
    radius: int,
    step: int,
    low: int,
    bits: int,
    border: int,
    cval: int,
    dst: wp.array,
) -> None:
    """Find the median of each square window of uint8 or int32, by bisection of the values."""
    parameters = [step, low, bits, border, cval]
    if dst.device.is_cuda:
        small = cuda.small_medians.get((src.dtype, radius))
        if small is not None:
            launch(small, src.shape, [src, *parameters], [dst])
        else:
            launch(cuda.medians[src.dtype], src.shape, [src, radius, *parameters], [dst])
        return
    planes, height, columns = src.shape
    rows = planes * height
    vector = wp.types.vector(WIDE, src.dtype)
    flat = padded(view(src, src.dtype, (rows, columns)), "median.src", WIDE)
    stored = flat.shape[1]
    wide = vectors(view(flat, src.dtype, (planes, height, stored)), vector)
    size = 2 * radius + 1
    count = slabs(rows, src.size * size**2)
    # Pixels are processed 64 at a time, so windows may reach this far beyond the end of a row.
    lines = (count * size, stored + 2 * radius * step + 64)
    window = scratch("median.window", lines, src.dtype, dst.device)
    inputs = [wide, struct_of(cpu.Options, (radius, *parameters)), window, vectors(window, vector)]
    launch_slabs(cpu.medians[src.dtype], rows, count, inputs, [dst])


def keys_of_floats(bits: wp.array, keys: wp.array) -> None:
    """Convert bits of floats to integers of the same order: invert negative ones below the sign."""
    flat = (bits.size,)
    launch(cuda.keys_of_floats, flat, [bits.reshape(flat)], [keys.reshape(flat)])


def floats_of_keys(keys: wp.array, bits: wp.array) -> None:
    """Undo `keys_of_floats`."""
    flat = (keys.size,)
    launch(cuda.floats_of_keys, flat, [keys.reshape(flat)], [bits.reshape(flat)])
