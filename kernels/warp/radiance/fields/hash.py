"""Multi-resolution hash encoding [Mueller et al., "Instant neural graphics primitives", 2022].

Level l is a grid of resolutions[l] cells along a side. A sample interpolates the two features of
the eight corners of its cell. If the level's table is large enough, each corner has its own entry;
otherwise a hash of its coordinates gives its entry. On the CPU a thread takes samples of a level;
on CUDA it takes one or several levels of a sample.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, slabs, view

from . import _hash_cpu as cpu
from . import _hash_cuda as cuda


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

    Level l has `resolutions` (L,) cells along a side, and the rows offsets[l] to offsets[l + 1] of
    `table` (entries, 2). Their number is a power of 2 if there are more corners, else a multiple of
    8.
    """
    levels = resolutions.shape[0]
    count = positions.shape[0] * levels
    inputs = [positions, total, resolutions, offsets]
    if features.device.is_cuda:
        together = next(n for n in (4, 2, 1) if levels % n == 0)
        inputs.append(_pairs(table, table.dtype))
        launch(cuda.encode(table.dtype, together), count // together, inputs, [features])
    else:
        parts = slabs(count, 16 * count)
        launch_slabs(cpu.encode, count, parts, [*inputs, table], [features])


def backward(
    positions: wp.array,
    total: wp.array,
    resolutions: wp.array,
    offsets: wp.array,
    d_features: wp.array,
    d_table: wp.array,
) -> None:
    """Add the gradients of the table, `d_table` (entries, 2), float32, from `d_features` (M, 2 L).

    On the CPU, sums are in the order of the samples, because no two threads add to one level. On
    CUDA, `d_table` may be int64, for fixed-point numbers, whose sums do not depend on the order.
    """
    levels = resolutions.shape[0]
    count = positions.shape[0] * levels
    inputs = [positions, total, resolutions, offsets]
    if d_table.device.is_cuda:
        pair = wp.types.vector(2, d_features.dtype)
        pairs = view(d_features, pair, (positions.shape[0], levels))
        outputs = [_pairs(d_table, wp.float32) if d_table.dtype is wp.float32 else d_table]
        whole = -(-count // BLOCK) * BLOCK
        kernel = cuda.backward(d_features.dtype, d_table.dtype)
        launch(kernel, whole, [*inputs, pairs], outputs)
    else:
        parts = min(levels, slabs(count, 16 * count))
        launch_slabs(cpu.backward, levels, parts, [*inputs, d_features], [d_table])
