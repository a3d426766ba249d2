"""The occupancy grid, which marks the cells of space that are not empty, in Warp.

As in instant-ngp, each cell keeps the largest density found in it, which decays. Cells above the
mean density, or above a given density, are occupied. A thread takes a cell, or 32 to set their
bits.
"""

import warp as wp

from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.warp._launch import BLOCK, launch, launch_each
from cvkern.kernels.warp._random import random_index
from cvkern.kernels.warp.radiance._space import in_cube, random_point

from . import _occupancy_cuda as cuda

wp.set_module_options({"enable_backward": False})

CELL = wp.constant(int(Draw.CELL))


@wp.kernel
def visit_kernel(
    stride: int,
    first: int,
    last: int,
    cells: int,
    count: int,
    every: bool,
    unbounded: bool,
    seed: int,
    step: wp.array[int],  # (1,)
    begin: int,
    # outputs
    visited: wp.array[int],  # (N,)
    positions: wp.array2d[float],  # (N, 3)
):
    """Draw a point of each cell that is visited."""
    for i in range(first + wp.tid(), last, stride):
        cell = wp.min(begin + i, count - 1)
        if not every:
            cell = random_index(seed, step[0], begin + i, CELL, count)
        visited[i] = cell
        at = in_cube(random_point(cell, cells, seed, step[0]), unbounded)
        for k in range(3):
            positions[i, k] = at[k]


@wp.kernel
def fade_kernel(
    stride: int,
    first: int,
    last: int,
    factor: float,
    # outputs
    density: wp.array[float],  # (count,)
):
    """Multiply by the factor."""
    for i in range(first + wp.tid(), last, stride):
        density[i] = density[i] * factor


@wp.kernel
def raise_kernel(
    visited: wp.array[int],  # (N,)
    sigma: wp.array[float],  # (N,)
    # outputs
    density: wp.array[float],  # (count,)
):
    """Take maxima, whose order has no effect."""
    i = wp.tid()
    wp.atomic_max(density, visited[i], sigma[i])


@wp.kernel
def sum_kernel(
    density: wp.array[float],  # (count,)
    # outputs
    parts: wp.array[float],  # (P,)
):
    """Sum a share of the cells."""
    part = wp.tid()
    share = (density.shape[0] + parts.shape[0] - 1) // parts.shape[0]
    total = float(0.0)
    for i in range(part * share, wp.min((part + 1) * share, density.shape[0])):
        total += density[i]
    parts[part] = total


@wp.kernel
def limit_kernel(
    parts: wp.array[float],  # (P,)
    count: int,
    least: float,
    # outputs
    limit: wp.array[float],  # (1,)
):
    """Set the limit to the mean, but not above `least`."""
    total = float(0.0)
    for part in range(parts.shape[0]):
        total += parts[part]
    limit[0] = wp.min(least, total / float(count))


@wp.kernel
def mark_kernel(
    stride: int,
    first: int,
    last: int,
    density: wp.array[float],  # (count,)
    limit: wp.array[float],  # (1,)
    # outputs
    bits: wp.array[wp.uint32],  # (count / 32,)
):
    """Set the bits of 32 cells."""
    for word in range(first + wp.tid(), last, stride):
        found = wp.uint32(0)
        for bit in range(32):
            if density[32 * word + bit] > limit[0]:
                found = found | (wp.uint32(1) << wp.uint32(bit))
        bits[word] = found


def visit(
    cells: int,
    count: int,
    every: bool,
    unbounded: bool,
    seed: int,
    step: wp.array,
    begin: int,
    visited: wp.array,
    positions: wp.array,
) -> None:
    """Draw a random point in each of N cells: of all `count` cells in order, or of random cells.

    If `every`, the cells begin at `begin`, and the last one repeats if there are no more.
    Otherwise they are the random cells of this step, beginning at number `begin`. The grid has
    `cells`^3 cells in each level. `visited` (N,) is filled with the numbers of the cells, and
    `positions` (N, 3) with the points in the cube of the field.
    """
    number = visited.shape[0]
    launch_each(
        visit_kernel,
        number,
        16 * number,
        [cells, count, every, unbounded, seed, step, begin],
        [visited, positions],
    )


def fade(factor: float, density: wp.array) -> None:
    """Multiply the densities of all cells, `density` (count,), by `factor`."""
    launch_each(fade_kernel, density.shape[0], density.shape[0], [factor], [density])


def raise_to(visited: wp.array, sigma: wp.array, density: wp.array) -> None:
    """Raise `density` (count,) of the `visited` (N,) cells to the densities `sigma` (N,)."""
    launch(raise_kernel, visited.shape[0], [visited, sigma], [density])


def mark(density: wp.array, least: float, parts: wp.array, limit: wp.array, bits: wp.array) -> None:
    """Set the bits of cells above the mean density, or above `least` if this is lower.

    `density` has (count,) numbers, `bits` (count / 32,) words with the first cell in the lowest
    bit. `parts` (P,) holds partial sums of the mean, and `limit` (1,) is filled with the limit that
    cells must exceed.
    """
    count = density.shape[0]
    if density.device.is_cuda:
        launch(cuda.sum_parts, BLOCK * parts.shape[0], [density], [parts])
        threads = BLOCK * min(cuda.BLOCKS, -(-count // (4 * BLOCK)))
        launch(cuda.mark, threads, [density, parts, least], [limit, bits])
        return
    launch(sum_kernel, parts.shape[0], [density], [parts])
    launch(limit_kernel, 1, [parts, count, least], [limit])
    launch_each(mark_kernel, count // 32, count, [density, limit], [bits])
