"""The occupancy grid, which marks the cells of space that are not empty, in Taichi.

As in instant-ngp, each cell keeps the largest density found in it, which decays. Cells above the
mean density, or above a given density, are occupied. One thread per cell.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_index
from cvkern.kernels.taichi.radiance._space import in_cube, random_point

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u32_1 = ti.types.ndarray(dtype=ti.u32, ndim=1)


@ti.kernel
def _visit(
    cells: ti.i32,
    count: ti.i32,
    every: ti.i32,
    unbounded: ti.i32,
    seed: ti.i32,
    step: i32_1,  # (1,)
    begin: ti.i32,
    # outputs
    visited: i32_1,  # (N,)
    positions: f32_2,  # (N, 3)
):
    for i in range(visited.shape[0]):
        cell = ti.min(begin + i, count - 1)
        if every == 0:
            cell = random_index(seed, step[0], begin + i, Draw.CELL, count)
        visited[i] = cell
        at = in_cube(random_point(cell, cells, seed, step[0]), unbounded)
        for k in ti.static(range(3)):
            positions[i, k] = at[k]


@primitive
def visit(
    cells: int,
    count: int,
    every: bool,
    unbounded: bool,
    seed: int,
    step: np.ndarray,
    begin: int,
    visited: np.ndarray,
    positions: np.ndarray,
) -> None:
    """Draw a random point in each of N cells: of all `count` cells in order, or of random cells.

    If `every`, the cells begin at `begin`, and the last one repeats if there are no more.
    Otherwise they are the random cells of this step, beginning at number `begin`. The grid has
    `cells`^3 cells in each level. `visited` (N,) is filled with the numbers of the cells, and
    `positions` (N, 3) with the points in the cube of the field.
    """
    _visit(cells, count, every, unbounded, seed, step, begin, visited, positions)


@ti.kernel
def _fade(
    factor: ti.f32,
    # outputs
    density: f32_1,  # (count,)
):
    for i in range(density.shape[0]):
        density[i] = density[i] * factor


@primitive
def fade(factor: float, density: np.ndarray) -> None:
    """Multiply the densities of all cells, `density` (count,), by `factor`."""
    _fade(factor, density)


@ti.kernel
def _raise_to(
    visited: i32_1,  # (N,)
    sigma: f32_1,  # (N,)
    # outputs
    density: f32_1,  # (count,)
):
    for i in range(visited.shape[0]):
        ti.atomic_max(density[visited[i]], sigma[i])


@primitive
def raise_to(visited: np.ndarray, sigma: np.ndarray, density: np.ndarray) -> None:
    """Raise `density` (count,) of the `visited` (N,) cells to the densities `sigma` (N,)."""
    _raise_to(visited, sigma, density)


@ti.kernel
def _mark(
    density: f32_1,  # (count,)
    least: ti.f32,
    # outputs
    parts: f32_1,  # (P,)
    limit: f32_1,  # (1,)
    bits: u32_1,  # (count / 32,)
):
    for part in range(parts.shape[0]):
        share = (density.shape[0] + parts.shape[0] - 1) // parts.shape[0]
        total = 0.0
        for i in range(part * share, ti.min((part + 1) * share, density.shape[0])):
            total += density[i]
        parts[part] = total
    for _ in range(1):
        total = 0.0
        for part in range(parts.shape[0]):
            total += parts[part]
        limit[0] = ti.min(least, total / density.shape[0])
    for word in range(bits.shape[0]):
        found = ti.u32(0)
        for bit in range(32):
            if density[32 * word + bit] > limit[0]:
                found |= ti.u32(1) << ti.cast(bit, ti.u32)
        bits[word] = found


@primitive
def mark(
    density: np.ndarray, least: float, parts: np.ndarray, limit: np.ndarray, bits: np.ndarray
) -> None:
    """Set the bits of cells above the mean density, or above `least` if this is lower.

    `density` has (count,) numbers, `bits` (count / 32,) words with the first cell in the lowest
    bit. `parts` (P,) holds partial sums of the mean, and `limit` (1,) is filled with the limit that
    cells must exceed.
    """
    _mark(density, least, parts, limit, bits)
