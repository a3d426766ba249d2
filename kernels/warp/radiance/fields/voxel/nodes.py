"""Steps over all nodes of a grid of density and colour, in Warp."""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import (
    launch,
    launch_each,
    launch_slabs,
    slabs,
    view,
)
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance.training._structs import AdamRule, Learnt

from . import _nodes_cpu as planes
from . import _nodes_cuda as nodes

wp.set_module_options({"enable_backward": False})


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
    """Mark 32 cells per thread; see :func:`mark`."""
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
    """Return the range of coarse nodes, first and end, of the cells that contain a fine node."""
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
    """Interpolate one node per thread; see :func:`upsample`."""
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


def total_variation(
    weight_density: float,
    weight_color: float,
    touched: wp.array,
    density: wp.array,
    color: wp.array,
    d_density: wp.array,
    d_color: wp.array,
) -> None:
    """Add, at touched nodes, the gradients of `weight / 2` times squared differences.

    The differences are those from the six neighbours of a node; each pair counts once. `touched`,
    `density` and `d_density` are (N, N, N), `color` and `d_color` (N, N, N, C).
    """
    side, width = density.shape[0], color.shape[3]
    weights = [weight_density, weight_color]
    if density.device.is_cuda:
        inputs = [*weights, *map(_flat, (touched, density, color)), side, width]
        outputs = [_flat(d_density), _flat(d_color)]
        count = nodes.threads(density.size)
        launch(nodes.total_variation, count, inputs, outputs, nodes.BLOCK)
    else:
        kernels = planes.kernels(width)
        rows = [view(a, kernels.row, (density.size,)) for a in (color, d_color)]
        inputs = [*weights, side, _flat(touched), _flat(density), rows[0]]
        outputs = [_flat(d_density), rows[1]]
        launch_slabs(kernels.total_variation, side, _planes(side), inputs, outputs)


def adam(
    rate_density: wp.array,
    rate_color: wp.array,
    factor: wp.array,
    rule: codes.AdamRule,
    touched: wp.array,
    density: codes.Learnt,
    color: codes.Learnt,
) -> None:
    """Take a step of Adam at touched nodes; afterwards no node is touched, and gradients are 0.

    Gradients are first multiplied by `factor` (1,). `rate_density` and `rate_color` (3,) are those
    of `training.adam.learning_rate` for the same step. `touched` and the arrays of `density` are
    (N, N, N), those of `color` (N, N, N, C). The rule's decay is 0, and it is not sparse.
    """
    side, width = touched.shape[0], color.weights.shape[3]
    rates = [rate_density, rate_color, factor, struct_of(AdamRule, rule)]
    outputs = [_flat(touched), struct_of(Learnt, map(_flat, density))]
    if touched.device.is_cuda:
        count = nodes.threads(touched.size)
        colors = struct_of(Learnt, map(_flat, color))
        launch(nodes.adam, count, [*rates, width], [*outputs, colors], nodes.BLOCK)
    else:
        kernels = planes.kernels(width)
        rows = struct_of(kernels.learnt, (view(a, kernels.row, (touched.size,)) for a in color))
        launch_slabs(kernels.adam, side, _planes(side), [side, *rates], [*outputs, rows])


def mark(density: wp.array, cells: int, least: float, bits: wp.array) -> None:
    """Set the bits of cells that have a node, inside or on a side, of a raw density above `least`.

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

    `fine` is 0 before. A node is written only if one of its coarse cells has a node of a raw
    density above `least`; `density` (N, N, N) holds the raw densities.
    """
    count = fine.shape[0] ** 3
    launch_each(upsample_kernel, count, 64 * count, [density, least, coarse], [fine])


def _planes(side: int) -> int:
    """Return the number of slabs of planes; many, because most of the work is in few planes."""
    return max(1, min(side, 8 * slabs(side, side**3)))


def _flat(array: wp.array) -> wp.array:
    return view(array, array.dtype, (array.size,))
