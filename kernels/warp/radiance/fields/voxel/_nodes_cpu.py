"""Steps over the whole grid of density and colour on the CPU: one thread per slab of planes.

nodes.py says what is computed. Only nodes that rays have touched are processed.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance.training._structs import AdamRule, Learnt

wp.set_module_options({"enable_backward": False})


class Kernels(NamedTuple):
    """The kernels for rows of one width."""

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

    @_native.each("_nodes_cpu.h", WIDTH=width)
    def variation_plane(
        k: int,
        weight_density: float,
        weight_color: float,
        touched: wp.array3d[wp.uint8],
        density: wp.array3d[float],
        color: wp.array4d[float],
        # outputs
        d_density: wp.array3d[float],  # added to
        d_color: wp.array4d[float],  # added to
    ): ...

    return Kernels(adam_plane, variation_plane)
