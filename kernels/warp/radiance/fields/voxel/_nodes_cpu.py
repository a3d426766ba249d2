"""Steps over the whole grid of density and colour on the CPU: one thread per slab of planes.

nodes.py says what is computed. Only nodes that rays have touched are processed.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance.training._structs import AdamRule, Learnt

wp.set_module_options({"enable_backward": False})


class Kernels(NamedTuple):
    """The kernels for rows of one width."""

    row: Any
    """A vector of this width."""
    adam: wp.Kernel
    total_variation: wp.Kernel


@cache
def kernels(width: int) -> Kernels:
    """Return the kernels for rows of `width` colour coefficients."""

    @_native.each("_nodes_cpu.h", WIDTH=width)
    def adam_plane(
        k: int,
        side: int,
        rate_density: wp.array[float],  # (3,)
        rate_color: wp.array[float],  # (3,)
        factor: wp.array[float],  # (1,)
        rule: AdamRule,
        # outputs
        touched: wp.array[wp.uint8],  # (N^3,): set to 0
        density: Learnt,  # (N^3,)
        color: Learnt,  # (N^3 C,)
    ): ...

    row = wp.types.vector(width, wp.float32)

    @wp.kernel
    def variation(
        slab: int,
        first: int,
        last: int,
        weight_density: float,
        weight_color: float,
        side: int,
        touched: wp.array[wp.uint8],  # (N^3,)
        density: wp.array[float],  # (N^3,)
        color: wp.array[row],  # (N^3,)
        # outputs
        d_density: wp.array[float],  # (N^3,): added to
        d_color: wp.array[row],  # (N^3,): added to
    ):
        """Add the gradients of squares of differences at the touched nodes of planes."""
        for node in range(first * side * side, last * side * side):
            if touched[node] != wp.uint8(0):
                i = node % side
                j = node // side % side
                k = node // (side * side)
                # A neighbour outside the grid counts as equal.
                a = node + wp.where(i > 0, -1, 0)
                b = node + wp.where(i + 1 < side, 1, 0)
                c = node + wp.where(j > 0, -side, 0)
                d = node + wp.where(j + 1 < side, side, 0)
                e = node + wp.where(k > 0, -side * side, 0)
                f = node + wp.where(k + 1 < side, side * side, 0)
                total = 6.0 * density[node] - density[a] - density[b] - density[c]
                total = total - density[d] - density[e] - density[f]
                d_density[node] = d_density[node] + weight_density * total
                around = (color[a] + color[b]) + (color[c] + color[d]) + (color[e] + color[f])
                change = weight_color * (6.0 * color[node] - around)
                d_color[node] = d_color[node] + change

    return Kernels(row, adam_plane, variation)
