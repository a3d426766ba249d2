"""Rank filters in Warp: one thread per slab of rows, or per element on CUDA.

The value of rank r is the largest v with at most r window values below v. Floats are compared as
integers: by their bits, in reversed order for negative ones.
"""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, padded, vectors
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._structs import struct_of

from . import _keys
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
        if radius in cuda.small_medians and src.dtype is wp.uint8:
            quads = (*src.shape[:2], -(-src.shape[2] // 4))
            inputs = [src, 2 * radius + 1, step, border, cval]
            launch(cuda.small_medians_of_bytes[radius], quads, inputs, [dst])
        elif radius in cuda.small_medians:
            launch(cuda.small_medians[radius], src.shape, [src, step, border, cval], [dst])
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
    # A slab has as many lines again for sorted columns.
    lines = (2 * count * size, stored + 2 * radius * step + 64)
    window = scratch("median.window", lines, src.dtype, dst.device)
    inputs = [wide, struct_of(cpu.Options, (radius, *parameters)), window, vectors(window, vector)]
    launch_slabs(cpu.medians[src.dtype], rows, count, inputs, [dst])


def keys_of_floats(bits: wp.array, keys: wp.array) -> None:
    """Convert bits of floats to integers of the same order: invert negative ones below the sign."""
    _convert(_keys.keys_of_floats, _keys.keys_of_lanes, bits, keys)


def floats_of_keys(keys: wp.array, bits: wp.array) -> None:
    """Undo `keys_of_floats`."""
    _convert(_keys.floats_of_keys, _keys.lanes_of_keys, keys, bits)


def _convert(kernel: wp.Kernel, lanes: wp.Kernel, src: wp.array, dst: wp.array) -> None:
    """Launch `kernel` for each element; on the CPU, whole lanes first, as `dst` may be `src`."""
    size = src.size
    whole = 0 if dst.device.is_cuda else size // LANES
    if whole:
        views = [vectors(view(a, wp.int32, (1, size)), _keys.i32_lanes) for a in (src, dst)]
        launch_slabs(lanes, whole, slabs(whole, size), views[:1], views[1:])
    rest = size - whole * LANES
    if rest:
        ends = [view(a, wp.int32, (size,))[size - rest :] for a in (src, dst)]
        launch(kernel, rest, ends[:1], ends[1:])
