"""Multi-resolution hash encoding on CUDA: a thread takes one or several levels of a sample.

hash.py describes the encoding. The samples of a level are processed together, because samples of
one ray share corners. Two corners that are neighbours along x are close in memory, both in a level
that holds all corners and in a hashed level, because the hash has the x coordinate in its last
bits. So a load of 16 bytes contains both in three of four cases.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import HASH_PRIMES
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._fixed_point import NATIVE

OPTIONS = {"enable_backward": False}

PRIME_Y, PRIME_Z = (wp.constant(wp.uint32(prime)) for prime in HASH_PRIMES)

vec16 = wp.types.vector(16, wp.float32)


@wp.struct
class Cell:
    """The cell of a sample in a level, and its offset."""

    i: int
    j: int
    k: int
    f: wp.vec3  # offset from the lower corner, in cells


@wp.func
def cell_of(positions: wp.array2d[float], sample: int, resolution: int) -> Cell:
    """Find the cell of a sample; a position at 1 is in the last cell."""
    cell = Cell()
    n = float(resolution)
    at = n * wp.vec3(positions[sample, 0], positions[sample, 1], positions[sample, 2])
    cell.i = wp.clamp(int(wp.floor(at[0])), 0, resolution - 1)
    cell.j = wp.clamp(int(wp.floor(at[1])), 0, resolution - 1)
    cell.k = wp.clamp(int(wp.floor(at[2])), 0, resolution - 1)
    cell.f = at - wp.vec3(float(cell.i), float(cell.j), float(cell.k))
    return cell


@wp.func
def entry_of(cell: Cell, corner: int, resolution: int, size: int) -> int:
    """Return the entry of a corner in its level's table; the corner's bits tell its sides."""
    i = wp.uint32(cell.i + (corner & 1))
    j = wp.uint32(cell.j + (corner >> 1 & 1))
    k = wp.uint32(cell.k + (corner >> 2))
    side = wp.uint32(resolution + 1)
    # Compute both indices without a branch, because most of the work is the same for all corners.
    # If the first one overflows 32 bits, it is not used.
    flat = (k * side + j) * side + i
    mixed = (i ^ j * PRIME_Y ^ k * PRIME_Z) & wp.uint32(size - 1)
    cube = wp.int64(side) * wp.int64(side) * wp.int64(side)
    return int(wp.where(cube <= wp.int64(size), flat, mixed))


@wp.func
def share_of(cell: Cell, corner: int) -> float:
    """Return the weight of a corner."""
    x = wp.where((corner & 1) != 0, cell.f[0], 1.0 - cell.f[0])
    y = wp.where((corner & 2) != 0, cell.f[1], 1.0 - cell.f[1])
    z = wp.where((corner & 4) != 0, cell.f[2], 1.0 - cell.f[2])
    return x * y * z


@cache
def encode(scalar: Any, together: int) -> wp.Kernel:
    """Return the kernel that looks up features in a precision, `together` levels per thread.

    The features that a thread writes are adjacent, so several levels fill sectors of memory.
    """
    pair, row = wp.types.vector(2, scalar), wp.types.vector(2 * together, scalar)

    size = 2 * together * wp.types.type_size_in_bytes(scalar)
    word = {4: "unsigned int", 8: "uint2"}.get(size, "uint4")

    @_native.func_native("_hash_cuda.cu")
    def two_halves(table: wp.array[pair], low: int, high: int) -> wp.vec4: ...

    @_native.func_native("_hash_cuda.cu")
    def two_floats(table: wp.array[pair], low: int, high: int) -> wp.vec4: ...

    two = two_halves if scalar is wp.float16 else two_floats

    @_native.func_native("_hash_cuda.cu", WORD=word)
    def store(features: wp.array2d[scalar], sample: int, group: int, numbers: row): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def encode(
        positions: wp.array2d[float],  # (M, 3), in [0, 1]
        total: wp.array[int],  # (1,)
        resolutions: wp.array[int],  # (L,)
        offsets: wp.array[int],  # (L + 1,)
        table: wp.array[pair],  # (entries,)
        # outputs
        features: wp.array2d[scalar],  # (M, 2 L)
    ):
        item = wp.tid()
        group = item // positions.shape[0]
        sample = item - group * positions.shape[0]
        if sample < total[0]:
            numbers = row()
            for n in range(together):
                level = group * together + n
                resolution = resolutions[level]
                begin = offsets[level]
                size = offsets[level + 1] - begin
                cell = cell_of(positions, sample, resolution)
                found = wp.vec2()
                for corner in range(0, 8, 2):
                    low = begin + entry_of(cell, corner, resolution, size)
                    high = begin + entry_of(cell, corner + 1, resolution, size)
                    near = two(table, low, high)
                    found += share_of(cell, corner) * wp.vec2(near[0], near[1])
                    found += share_of(cell, corner + 1) * wp.vec2(near[2], near[3])
                numbers[2 * n] = scalar(found[0])
                numbers[2 * n + 1] = scalar(found[1])
            store(features, sample, group, numbers)

    return encode


@_native.func_native("_hash_cuda.cu")
def begins_run(key: wp.int64) -> bool:
    """Tell whether the preceding lane has another key; for a whole warp."""
    ...


@_native.func_native("_hash_cuda.cu")
def add_up_run(begins: bool, values: vec16) -> vec16:
    """Return, in the first lane of a run, the sums over its lanes; for a whole warp."""
    ...


@_native.func_native("_hash_cuda.cu")
def add_two(table: wp.array[wp.vec2], low: int, high: int, x: float, y: float, z: float, w: float):
    """Add to two entries atomically, with as many numbers at a time as the GPU supports."""
    ...


@_native.func_native("_hash_fixed_cuda.cu", **NATIVE)
def add_two_fixed(
    table: wp.array2d[wp.int64], low: int, high: int, x: float, y: float, z: float, w: float
):
    """Add to two entries of fixed-point numbers, whose sums do not depend on the order."""
    ...


@cache
def backward(scalar: Any, sums: Any) -> wp.Kernel:
    """Return the kernel that adds gradients of features, in a precision, to those of the table.

    The table's gradients are float32, or int64 for fixed-point numbers. The gradients of adjacent
    samples in one cell are added first. Launch whole blocks of threads, if necessary more than
    samples and levels.
    """
    pair = wp.types.vector(2, scalar)
    exact = sums is wp.int64
    table = wp.array2d[sums] if exact else wp.array[wp.vec2]
    add = add_two_fixed if exact else add_two

    @wp.kernel(module="unique", module_options=OPTIONS)
    def backward(
        positions: wp.array2d[float],  # (M, 3)
        total: wp.array[int],  # (1,)
        resolutions: wp.array[int],  # (L,)
        offsets: wp.array[int],  # (L + 1,)
        d_features: wp.array2d[pair],  # (M, L)
        # outputs
        d_table: table,  # (entries,) pairs, or (entries, 2): added to
    ):
        # A feature is a weighted sum of entries, so an entry's gradient is its weight times the
        # feature's gradient.
        item = wp.tid()
        level = item // positions.shape[0]
        sample = item - level * positions.shape[0]
        key = wp.int64(-1)  # the key of samples that have no gradient
        cell = Cell()
        values = vec16()
        if level < resolutions.shape[0] and sample < total[0]:
            d = d_features[sample, level]
            dx = float(d[0])
            dy = float(d[1])
            if dx != 0.0 or dy != 0.0:
                cell = cell_of(positions, sample, resolutions[level])
                # There are up to 2^20 cells along a side; adjacent levels in a warp differ by 1.
                place = wp.int64(cell.k) | wp.int64(level & 1) << wp.int64(20)
                place = wp.int64(cell.j) | place << wp.int64(20)
                key = wp.int64(cell.i) | place << wp.int64(20)
                for corner in range(8):
                    share = share_of(cell, corner)
                    values[2 * corner] = share * dx
                    values[2 * corner + 1] = share * dy
        begins = begins_run(key)
        values = add_up_run(begins, values)
        if begins and key >= wp.int64(0):
            resolution = resolutions[level]
            begin = offsets[level]
            size = offsets[level + 1] - begin
            for corner in range(0, 8, 2):
                low = begin + entry_of(cell, corner, resolution, size)
                high = begin + entry_of(cell, corner + 1, resolution, size)
                at = 2 * corner
                add(d_table, low, high, values[at], values[at + 1], values[at + 2], values[at + 3])

    return backward
