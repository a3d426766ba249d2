"""Steps over the whole grid of density and colour on CUDA.

nodes.py says what is computed. Only the few nodes that rays have touched learn. Each thread of a
block tests NODES nodes, and the block lists the touched ones in shared memory. Then a thread takes
one of these, or four coefficients of one.
"""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance.training._structs import AdamRule, Learnt

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

BLOCK = 256  # threads
NODES = 8  # nodes that a thread tests


def threads(nodes: int) -> int:
    """Return the number of threads, in whole blocks, that test `nodes` nodes."""
    return -(-nodes // (NODES * BLOCK)) * BLOCK


@_native.func_native("_nodes_cuda.cu", NODES=NODES, BLOCK=BLOCK)
def smooth(
    thread: int,
    weight_density: float,
    weight_color: float,
    touched: wp.array[wp.uint8],
    density: wp.array[float],
    color: wp.array[float],
    side: int,
    width: int,
    d_density: wp.array[float],
    d_color: wp.array[float],
): ...


@wp.kernel
def total_variation(
    weight_density: float,
    weight_color: float,
    touched: wp.array[wp.uint8],  # (N^3,)
    density: wp.array[float],  # (N^3,)
    color: wp.array[float],  # (N^3 C,)
    side: int,
    width: int,
    # outputs
    d_density: wp.array[float],  # added to
    d_color: wp.array[float],  # added to
):
    smooth(
        wp.tid(), weight_density, weight_color, touched, density, color, side, width, d_density,
        d_color,
    )  # fmt: skip


@_native.func_native("_nodes_cuda.cu", NODES=NODES, BLOCK=BLOCK)
def move(
    thread: int,
    rate_density: wp.array[float],
    rate_color: wp.array[float],
    factor: wp.array[float],
    rule: AdamRule,
    width: int,
    touched: wp.array[wp.uint8],
    density: Learnt,
    color: Learnt,
): ...


@wp.kernel
def adam(
    rate_density: wp.array[float],  # (3,)
    rate_color: wp.array[float],  # (3,)
    factor: wp.array[float],  # (1,)
    rule: AdamRule,
    width: int,
    # outputs
    touched: wp.array[wp.uint8],  # (N^3,): set to 0
    density: Learnt,  # (N^3,)
    color: Learnt,  # (N^3 C,)
):
    move(wp.tid(), rate_density, rate_color, factor, rule, width, touched, density, color)


@_native.func_native("_bits_cuda.cu")
def mark_cell(
    cell: int,
    density: wp.array3d[float],
    cells: int,
    size: int,
    least: float,
    bits: wp.array[wp.uint32],
): ...


@wp.kernel
def mark(
    density: wp.array3d[float],  # (N + 1, N + 1, N + 1)
    cells: int,
    size: int,  # N / cells
    least: float,
    # outputs
    bits: wp.array[wp.uint32],  # (cells^3 / 32,)
):
    mark_cell(wp.tid(), density, cells, size, least, bits)
