"""Rays through a grid of density and colour: marched, read and composited at once, in Warp.

The grid has N + 1 nodes (k, j, i) along each side, at z, y, x = -1 .. 1, or in all of space,
contracted, at -2 .. 2. Between them its numbers are interpolated linearly: a raw density r, with
density e^r, or 0 where r is at most `least`, and for each channel the coefficients of spherical
harmonics of the direction, whose sum s is made a colour 1 / (1 + e^-s). The density is cut off at
e^11, but its gradient is not made 0 there. With w_i, T_i, G_i as in radiance_composite.py:

    dL/dr_i = sigma_i d_i (T_{i+1} G_i - sum_{j > i} w_j G_j) where r_i > least, else 0,
    dL/ds_i = w_i dL/dC c_i (1 - c_i),    at a node: dL/dr = sum_i b_i dL/dr_i,
    and of a coefficient sum_i b_i Y dL/ds_i, with b_i the node's share in sample i, Y the harmonic.

The backward pass walks again. What it needs of the samples behind i is what the forward pass
returned, less what has been passed: sum_j w_j G_j is linear in that. On CUDA a warp walks a ray and
adds by atomics, whose order does not show where sums are integers; on the CPU a thread walks some
rays and notes what each sample has to add, and then each thread adds to nodes of its own, in the
order of the rays.
"""

import numpy as np
import warp as wp

from . import _radiance_voxel_blocks as blocks
from . import _radiance_voxel_nodes_blocks as nodes
from . import _radiance_voxel_planes as planes
from . import _radiance_voxel_rows as rows
from ._launch import cpu_threads, launch, launch_each, launch_slabs, scratch, slabs, view
from ._radiance_voxel_march import march_of
from ._radiance_voxel_walk import RECORD

wp.set_module_options({"enable_backward": False})

RAYS = 64  # of a slab on the CPU: as they differ in length, there are many slabs
SAMPLES = 4096  # what is kept of samples has room for a multiple of so many


@wp.kernel
def mark_kernel(
    stride: int,
    first: int,
    last: int,
    density: wp.array3d[float],  # (N + 1, N + 1, N + 1)
    cells: int,
    size: int,  # N / cells
    least: float,
    # outputs
    bits: wp.array[wp.uint32],  # (cells^3 / 32,)
):
    """One thread 32 cells: see :func:`mark`."""
    for word in range(first + wp.tid(), last, stride):
        found = wp.uint32(0)
        for bit in range(32):
            cell = 32 * word + bit
            i = cell % cells * size
            j = cell // cells % cells * size
            k = cell // (cells * cells) * size
            most = float(-1.0e30)
            for z in range(k, k + size + 1):
                for y in range(j, j + size + 1):
                    for x in range(i, i + size + 1):
                        most = wp.max(most, density[z, y, x])
            if most > least:
                found = found | (wp.uint32(1) << wp.uint32(bit))
        bits[word] = found


@wp.func
def coarse_nodes(k: int, side: int, most: int) -> wp.vec2i:
    """Return the first coarse node of the cells a fine one is in, and the one behind the last."""
    # Along an axis of `most` coarse and `side` fine cells, node k is at k most / side.
    return wp.vec2i(
        wp.max((k * most + side - 1) // side - 1, 0), wp.min(k * most // side, most - 1) + 2
    )


@wp.func
def share(k: int, node: int, side: int, most: int) -> float:
    """Return the weight of a coarse node at a fine one."""
    return wp.max(1.0 - wp.abs(float(k * most - node * side)) / float(side), 0.0)


@wp.kernel
def upsample_kernel(
    stride: int,
    first: int,
    last: int,
    density: wp.array3d[float],  # (N, N, N)
    least: float,
    coarse: wp.array4d[float],  # (N, N, N, C)
    # outputs
    fine: wp.array4d[float],  # (F, F, F, C)
):
    """One thread a node: see :func:`upsample`."""
    side = fine.shape[0]
    most = coarse.shape[0] - 1
    for node in range(first + wp.tid(), last, stride):
        at = wp.vec3i(node % side, node // side % side, node // (side * side))
        xs = coarse_nodes(at[0], side - 1, most)
        ys = coarse_nodes(at[1], side - 1, most)
        zs = coarse_nodes(at[2], side - 1, most)
        wanted = bool(False)
        for k in range(zs[0], zs[1]):
            for j in range(ys[0], ys[1]):
                for i in range(xs[0], xs[1]):
                    wanted = wanted or density[k, j, i] > least
        if not wanted:
            continue
        for c in range(fine.shape[3]):
            total = float(0.0)
            for k in range(zs[0], zs[1]):
                for j in range(ys[0], ys[1]):
                    for i in range(xs[0], xs[1]):
                        total += (
                            share(at[0], i, side - 1, most)
                            * share(at[1], j, side - 1, most)
                            * share(at[2], k, side - 1, most)
                            * coarse[k, j, i, c]
                        )
            fine[at[2], at[1], at[0], c] = total


def render(
    origins: wp.array,
    directions: wp.array,
    active: wp.array,
    bits: wp.array,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    unbounded: bool,
    jittered: bool,
    seed: int,
    step: wp.array,
    stop: float,
    least: float,
    basis: int,
    density: wp.array,
    color: wp.array,
    colors: wp.array,
    opacity: wp.array,
    depth: wp.array,
    distortion: wp.array,
    samples: wp.array,
) -> None:
    """Make out what the first `active` (1,) rays see, and how many samples had any density.

    `origins` and unit `directions` (R, 3), `near` to `jittered`, `seed` and `step` (1,) are as in
    `radiance_march.march_rays`, but `cone` is 0 unless `unbounded`; `bits` has one level of
    cells^3, each a power of 2 of the grid's cells along a side. A ray ends where no more than
    `stop` of the light is left. `density` (N + 1, N + 1, N + 1) has raw densities, `color`
    (N + 1, N + 1, N + 1, C), of C = 16 or 32, the `basis` (1, 4 or 9) coefficients of each channel
    in turn. `colors` (R, 3), `opacity`, `depth` and `distortion` (R,) are filled as by
    `radiance_composite.forward`, and `samples` (R,) with the numbers of samples, 0 for the other
    rays.
    """
    count = origins.shape[0]
    march = march_of(
        bits, cells, near, far, finest, cone, unbounded, jittered, seed, step, stop, least, basis,
        density, color,
    )  # fmt: skip
    inputs = [origins, directions, active, march]
    outputs = [colors, opacity, depth, distortion, samples]
    if density.device.is_cuda:
        launch(blocks.render, blocks.THREADS * count, inputs, outputs, blocks.BLOCK)
    else:
        kernel = rows.kernels(color.shape[3]).render
        launch_slabs(kernel, count, -(-count // RAYS), inputs, outputs)


def render_backward(
    d_colors: wp.array,
    d_opacity: wp.array,
    d_depth: wp.array,
    d_distortion: wp.array,
    origins: wp.array,
    directions: wp.array,
    active: wp.array,
    bits: wp.array,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    unbounded: bool,
    jittered: bool,
    seed: int,
    step: wp.array,
    stop: float,
    least: float,
    basis: int,
    density: wp.array,
    color: wp.array,
    colors: wp.array,
    opacity: wp.array,
    depth: wp.array,
    distortion: wp.array,
    samples: wp.array,
    d_density: wp.array,
    d_color: wp.array,
    touched: wp.array,
) -> None:
    """Add the gradients of the grid, and mark its nodes that have any.

    `d_colors` (R, 3), `d_opacity`, `d_depth` and `d_distortion` (R,) are those of what
    :func:`render` made of the same rays, `colors` to `samples`. `d_density` and `d_color` have the
    shapes of the grid, as has `touched` (N + 1, N + 1, N + 1), which is set to 1 at such nodes. On
    CUDA `d_density` and `d_color` may be int64, of fixed-point numbers: their sums are the same in
    any order.
    """
    count = origins.shape[0]
    march = march_of(
        bits, cells, near, far, finest, cone, unbounded, jittered, seed, step, stop, least, basis,
        density, color,
    )  # fmt: skip
    gradients = [d_colors, d_opacity, d_depth, d_distortion]
    rendered = [colors, opacity, depth, distortion]
    outputs = [d_density, d_color, touched]
    if density.device.is_cuda:
        inputs = [*gradients, origins, directions, active, march, *rendered, samples]
        kernel = blocks.render_backward(d_color.dtype)
        launch(kernel, blocks.THREADS * count, inputs, outputs, blocks.BLOCK)
        return
    kernels = rows.kernels(color.shape[3])
    # Kernels of the CPU are done when their launch is: the host can read what they wrote.
    ends = scratch("voxel.ends", (count,), wp.int64, density.device)
    np.cumsum(samples.numpy(), out=ends.numpy())
    room = -(-max(1, int(ends.numpy()[-1])) // SAMPLES) * SAMPLES
    records = scratch("voxel.records", (room, RECORD), wp.float32, density.device)
    inputs = [*gradients, origins, directions, march, *rendered, ends]
    launch_slabs(kernels.trace, count, -(-count // RAYS), inputs, [records])
    owners = 2 if cpu_threads() <= 2 else 4
    inputs = [owners, directions, basis, ends, records]
    launch_slabs(kernels.scatter, owners, owners, inputs, outputs)


def total_variation(
    weight_density: float,
    weight_color: float,
    touched: wp.array,
    density: wp.array,
    color: wp.array,
    d_density: wp.array,
    d_color: wp.array,
) -> None:
    """At touched nodes, add the gradients of `weight / 2` times the squares of differences.

    Those are the differences from the six neighbours of a node, each pair counted once. `touched`,
    `density` and `d_density` are (N, N, N), `color` and `d_color` (N, N, N, C).
    """
    side, width = density.shape[0], color.shape[3]
    weights, grid = [weight_density, weight_color], [touched, density, color]
    outputs = [d_density, d_color]
    if density.device.is_cuda:
        inputs = [*weights, *map(_flat, grid), side, width]
        count = nodes.threads(density.size)
        launch(nodes.total_variation, count, inputs, [_flat(a) for a in outputs], nodes.BLOCK)
    else:
        kernel = planes.kernels(width).total_variation
        launch_slabs(kernel, side, _planes(side), [*weights, *grid], outputs)


def adam(
    rate_density: wp.array,
    rate_color: wp.array,
    factor: wp.array,
    beta1: float,
    beta2: float,
    epsilon: float,
    touched: wp.array,
    d_density: wp.array,
    density_mean: wp.array,
    density_square: wp.array,
    density: wp.array,
    d_color: wp.array,
    color_mean: wp.array,
    color_square: wp.array,
    color: wp.array,
) -> None:
    """One step of Adam at touched nodes, which it leaves untouched, with gradients of 0.

    Before, these are multiplied by `factor` (1,). `rate_density` and `rate_color` (3,) are those of
    `radiance_adam.learning_rate` for the same step. What is of density, and `touched`, is
    (N, N, N), what is of colour (N, N, N, C).
    """
    side, width = density.shape[0], color.shape[3]
    inputs = [rate_density, rate_color, factor, beta1, beta2, epsilon]
    outputs = [
        touched, d_density, density_mean, density_square, density, d_color, color_mean,
        color_square, color,
    ]  # fmt: skip
    if density.device.is_cuda:
        count = nodes.threads(density.size)
        launch(nodes.adam, count, [*inputs, width], [_flat(a) for a in outputs], nodes.BLOCK)
    else:
        launch_slabs(planes.kernels(width).adam, side, _planes(side), inputs, outputs)


def mark(density: wp.array, cells: int, least: float, bits: wp.array) -> None:
    """Set the bits of cells with a node of a raw density above `least`, in them or on their sides.

    `density` has (N + 1, N + 1, N + 1) nodes, `bits` (cells^3 / 32,) words with the first cell in
    the lowest bit; N is a multiple of `cells`.
    """
    count = cells**3 // 32
    size = (density.shape[0] - 1) // cells
    inputs = [density, cells, size, least]
    if density.device.is_cuda:
        launch(nodes.mark, 32 * count, inputs, [bits])
    else:
        launch_each(mark_kernel, count, 32 * 64 * count, inputs, [bits])


def upsample(density: wp.array, least: float, coarse: wp.array, fine: wp.array) -> None:
    """Interpolate a grid, `coarse` (N, N, N, C), at the nodes of a `fine` one, (F, F, F, C).

    `fine` comes as zeros, and nodes that are in no coarse cell with a node of a raw density above
    `least` are not written; `density` (N, N, N) has those.
    """
    count = fine.shape[0] ** 3
    launch_each(upsample_kernel, count, 64 * count, [density, least, coarse], [fine])


def _planes(side: int) -> int:
    """Into how many slabs the planes of a grid are cut: many, as few have much in them."""
    return max(1, min(side, 8 * slabs(side, side**3)))


def _flat(array: wp.array) -> wp.array:
    return view(array, array.dtype, (array.size,))
