"""Multi-resolution hash encoding [Mueller et al., "Instant neural graphics primitives", 2022].

Level l is a grid of resolutions[l] cells a side. A sample takes the two features of each of the
eight corners round it, weighted by nearness; corners have a place each where the level's table is
large enough, else the place that a hash of their coordinates says.

On CUDA one thread a sample and level, the samples of a level together: those of one ray share
corners. The backward pass adds in the order in which samples happen to come, which does not show
where sums are integers.
"""

from functools import cache
from typing import Any

import warp as wp

from . import _radiance_hash_rows as rows
from ._fixed_point import fixed
from ._launch import launch, launch_slabs, slabs, view

OPTIONS = {"enable_backward": False}  # of kernels that are made for a dtype

PRIME_Y = wp.constant(wp.uint32(2654435761))
PRIME_Z = wp.constant(wp.uint32(805459861))


@wp.struct
class Cell:
    """Where a sample is in a level."""

    i: int
    j: int
    k: int
    f: wp.vec3  # from the lower corner, in cells


@wp.func
def cell_of(positions: wp.array2d[float], sample: int, resolution: int) -> Cell:
    """Find the cell of a sample: those at 1 are in the last one."""
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
    """Return the place in its level's table of a corner, whose bits say on which sides it is."""
    i = cell.i + (corner & 1)
    j = cell.j + (corner >> 1 & 1)
    k = cell.k + (corner >> 2)
    side = wp.int64(resolution + 1)
    if side * side * side <= wp.int64(size):
        return (k * (resolution + 1) + j) * (resolution + 1) + i
    mixed = wp.uint32(i) ^ wp.uint32(j) * PRIME_Y ^ wp.uint32(k) * PRIME_Z
    return int(mixed & wp.uint32(size - 1))


@wp.func
def share_of(cell: Cell, corner: int) -> float:
    """Return the weight of a corner."""
    x = wp.where((corner & 1) != 0, cell.f[0], 1.0 - cell.f[0])
    y = wp.where((corner & 2) != 0, cell.f[1], 1.0 - cell.f[1])
    z = wp.where((corner & 4) != 0, cell.f[2], 1.0 - cell.f[2])
    return x * y * z


@wp.func_native("""
    float* to = (float*)table.data + 2 * (size_t)entry;
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("red.global.add.v2.f32 [%0], {%1, %2};" ::"l"(to), "f"(x), "f"(y) : "memory");
#else
    atomicAdd(to, x);
    atomicAdd(to + 1, y);
#endif
""")
def add_pair(table: wp.array[wp.vec2], entry: int, x: float, y: float):
    """Add to an entry atomically, both numbers at a time where the GPU can."""


@wp.func
def add_fixed(table: wp.array2d[wp.int64], entry: int, x: float, y: float):
    """Add to an entry of fixed-point numbers."""
    wp.atomic_add(table, entry, 0, fixed(x))
    wp.atomic_add(table, entry, 1, fixed(y))


@cache
def _encode(scalar: Any) -> wp.Kernel:
    pair = wp.types.vector(2, scalar)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def encode(
        positions: wp.array2d[float],  # (M, 3), in [0, 1]
        total: wp.array[int],  # (1,)
        resolutions: wp.array[int],  # (L,)
        offsets: wp.array[int],  # (L + 1,)
        table: wp.array[pair],  # (entries,)
        # outputs
        features: wp.array2d[pair],  # (M, L)
    ):
        item = wp.tid()
        level = item // positions.shape[0]
        sample = item - level * positions.shape[0]
        if sample < total[0]:
            resolution = resolutions[level]
            begin = offsets[level]
            size = offsets[level + 1] - begin
            cell = cell_of(positions, sample, resolution)
            found = wp.vec2()
            for corner in range(8):
                entry = table[begin + entry_of(cell, corner, resolution, size)]
                found += share_of(cell, corner) * wp.vec2(float(entry[0]), float(entry[1]))
            features[sample, level] = pair(scalar(found[0]), scalar(found[1]))

    return encode


@cache
def _backward(scalar: Any, sums: Any) -> wp.Kernel:
    pair = wp.types.vector(2, scalar)
    exact = sums is wp.int64
    table = wp.array2d[sums] if exact else wp.array[wp.vec2]
    add = add_fixed if exact else add_pair

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
        # A feature is a weighted sum of entries: an entry's gradient is its weight times that.
        item = wp.tid()
        level = item // positions.shape[0]
        sample = item - level * positions.shape[0]
        if sample < total[0]:
            d = d_features[sample, level]
            dx = float(d[0])
            dy = float(d[1])
            if dx != 0.0 or dy != 0.0:
                resolution = resolutions[level]
                begin = offsets[level]
                size = offsets[level + 1] - begin
                cell = cell_of(positions, sample, resolution)
                for corner in range(8):
                    share = share_of(cell, corner)
                    entry = begin + entry_of(cell, corner, resolution, size)
                    add(d_table, entry, share * dx, share * dy)

    return backward


def _pairs(array: wp.array, scalar: Any) -> wp.array:
    """View the (entries, 2) numbers of a table as (entries,) pairs."""
    return view(array, wp.types.vector(2, scalar), array.shape[:1])


def encode(
    positions: wp.array,
    total: wp.array,
    resolutions: wp.array,
    offsets: wp.array,
    table: wp.array,
    features: wp.array,
) -> None:
    """Look up the features (M, 2 L) of the first `total` (1,) of `positions` (M, 3) in [0, 1].

    Level l has `resolutions` (L,) cells a side, and the rows of `table` (entries, 2) from
    offsets[l] up to offsets[l + 1]: a power of 2 if there are more corners.
    """
    levels = resolutions.shape[0]
    count = positions.shape[0] * levels
    inputs = [positions, total, resolutions, offsets]
    if features.device.is_cuda:
        pair = wp.types.vector(2, table.dtype)
        pairs = view(features, pair, (positions.shape[0], levels))
        launch(_encode(table.dtype), count, [*inputs, _pairs(table, table.dtype)], [pairs])
    else:
        parts = slabs(count, 16 * count)
        launch_slabs(rows.encode, count, parts, [*inputs, table], [features])


def backward(
    positions: wp.array,
    total: wp.array,
    resolutions: wp.array,
    offsets: wp.array,
    d_features: wp.array,
    d_table: wp.array,
) -> None:
    """Add to `d_table` (entries, 2), float32, what `d_features` (M, 2 L) make of it.

    On the CPU in the order of the samples, as no two threads add to one level. On CUDA it may be
    int64, of fixed-point numbers: their sums are the same in any order.
    """
    levels = resolutions.shape[0]
    count = positions.shape[0] * levels
    inputs = [positions, total, resolutions, offsets]
    if d_table.device.is_cuda:
        pair = wp.types.vector(2, d_features.dtype)
        pairs = view(d_features, pair, (positions.shape[0], levels))
        outputs = [_pairs(d_table, wp.float32) if d_table.dtype is wp.float32 else d_table]
        kernel = _backward(d_features.dtype, d_table.dtype)
        launch(kernel, count, [*inputs, pairs], outputs)
    else:
        parts = min(levels, slabs(count, 16 * count))
        launch_slabs(rows.backward, levels, parts, [*inputs, d_features], [d_table])
