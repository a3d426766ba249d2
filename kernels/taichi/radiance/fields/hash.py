"""Multi-resolution hash encoding [Mueller et al., "Instant neural graphics primitives", 2022].

Level l is a grid of resolutions[l] cells along a side. A sample interpolates the two features of
the eight corners of its cell. If the level's table is large enough, each corner has its own entry;
otherwise a hash of its coordinates gives its entry. A thread takes samples of a level.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.radiance import HASH_PRIMES
from cvkern.kernels.taichi._launch import on_cpu, primitive
from cvkern.kernels.taichi.radiance._fixed_point import add

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)
ivec3 = ti.types.vector(3, ti.i32)


@ti.func
def _cell(at: vec3, resolution: ti.i32) -> ivec3:
    """Return the cell of a point, in units of cells; points at a far side are in the last cell."""
    return ti.math.clamp(ti.floor(at, ti.i32), 0, resolution - 1)


@ti.func
def _entry(corner: ivec3, resolution: ti.i32, size: ti.i32) -> ti.i32:
    """Return the index of a corner of the grid in its level's table."""
    side = ti.cast(resolution + 1, ti.i64)
    entry = (corner[2] * (resolution + 1) + corner[1]) * (resolution + 1) + corner[0]
    if side * side * side > size:
        i = ti.cast(corner[0], ti.u32)
        j = ti.cast(corner[1], ti.u32) * ti.u32(HASH_PRIMES[0])
        k = ti.cast(corner[2], ti.u32) * ti.u32(HASH_PRIMES[1])
        entry = ti.cast((i ^ j ^ k) & ti.cast(size - 1, ti.u32), ti.i32)
    return entry


@ti.func
def _share(offset: vec3, side: ti.template()) -> ti.f32:
    """Return the weight of a corner; `side` tells on which sides of the cell it is."""
    share = 1.0
    for k in ti.static(range(3)):
        share *= offset[k] if ti.static(side[k] == 1) else 1.0 - offset[k]
    return share


@ti.kernel
def _encode(
    positions: f32_2,  # (M, 3), in [0, 1]
    total: i32_1,  # (1,)
    resolutions: i32_1,  # (L,)
    offsets: i32_1,  # (L + 1,)
    table: f32_2,  # (entries, 2)
    # outputs
    features: f32_2,  # (M, 2 L)
):
    for sample in range(ti.min(total[0], positions.shape[0])):
        for level in range(resolutions.shape[0]):
            resolution = resolutions[level]
            begin = offsets[level]
            size = offsets[level + 1] - begin
            point = vec3(positions[sample, 0], positions[sample, 1], positions[sample, 2])
            at = resolution * point
            cell = _cell(at, resolution)
            x = 0.0
            y = 0.0
            for i, j, k in ti.static(ti.ndrange(2, 2, 2)):
                entry = begin + _entry(cell + ivec3(i, j, k), resolution, size)
                share = _share(at - cell, (i, j, k))
                x += share * table[entry, 0]
                y += share * table[entry, 1]
            features[sample, 2 * level] = x
            features[sample, 2 * level + 1] = y


@primitive
def encode(
    positions: np.ndarray,
    total: np.ndarray,
    resolutions: np.ndarray,
    offsets: np.ndarray,
    table: np.ndarray,
    features: np.ndarray,
) -> None:
    """Look up the features (M, 2 L) of the first `total` (1,) of `positions` (M, 3) in [0, 1].

    Level l has `resolutions` (L,) cells along a side, and the rows offsets[l] to offsets[l + 1] of
    `table` (entries, 2). Their number is a power of 2 if there are more corners, else a multiple of
    8.
    """
    _encode(positions, total, resolutions, offsets, table, features)


@ti.kernel
def _backward(
    positions: f32_2,  # (M, 3), in [0, 1]
    total: i32_1,  # (1,)
    resolutions: i32_1,  # (L,)
    offsets: i32_1,  # (L + 1,)
    d_features: f32_2,  # (M, 2 L)
    threads: ti.i32,
    exact: ti.template(),
    # outputs
    d_table: ti.types.ndarray(ndim=2),  # (entries, 2), int64 if exact: added to
):
    # A feature is a weighted sum of entries, so an entry's gradient is its weight times the
    # feature's gradient.
    for level, thread in ti.ndrange(resolutions.shape[0], threads):
        resolution = resolutions[level]
        begin = offsets[level]
        size = offsets[level + 1] - begin
        for turn in range((total[0] - thread + threads - 1) // threads):
            sample = thread + turn * threads
            dx = d_features[sample, 2 * level]
            dy = d_features[sample, 2 * level + 1]
            if dx != 0.0 or dy != 0.0:
                point = vec3(positions[sample, 0], positions[sample, 1], positions[sample, 2])
                at = resolution * point
                cell = _cell(at, resolution)
                for i, j, k in ti.static(ti.ndrange(2, 2, 2)):
                    entry = begin + _entry(cell + ivec3(i, j, k), resolution, size)
                    share = _share(at - cell, (i, j, k))
                    add(d_table[entry, 0], share * dx, exact)
                    add(d_table[entry, 1], share * dy, exact)


@primitive
def backward(
    positions: np.ndarray,
    total: np.ndarray,
    resolutions: np.ndarray,
    offsets: np.ndarray,
    d_features: np.ndarray,
    d_table: np.ndarray,
) -> None:
    """Add the gradients of the table, `d_table` (entries, 2), float32, from `d_features` (M, 2 L).

    On the CPU, sums are in the order of the samples, because no two threads add to one level. On
    CUDA, `d_table` may be int64, for fixed-point numbers, whose sums do not depend on the order.
    """
    threads, exact = 1 if on_cpu() else positions.shape[0], d_table.dtype == np.int64
    _backward(positions, total, resolutions, offsets, d_features, threads, exact, d_table)
