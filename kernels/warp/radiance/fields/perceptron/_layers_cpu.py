"""Layers of a perceptron on the CPU, in float32: one thread per slab of samples.

``dst = src w``, and ``src^T dy`` for the gradient of w. Each native loop keeps LANES sums in vector
registers, and reads the other operand row by row.
"""

import warp as wp

from cvkern.kernels.warp import _native

from ._product import Product

wp.set_module_options({"enable_backward": False})

LANES = 64  # sums at a time; rows of weights are padded to a multiple of this
ROWS = 16  # samples after which sums of a weight gradient are written


@_native.func_native("_layers_cpu.h", LANES=LANES)
def multiply(
    first: int,
    last: int,
    src: wp.array2d[float],
    w: wp.array2d[float],
    gates: wp.array2d[float],
    total: wp.array[int],
    product: Product,
    dst: wp.array2d[float],
): ...


@wp.kernel
def product(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],  # (M, >= depth)
    w: wp.array2d[float],  # (depth, columns padded to a multiple of LANES)
    gates: wp.array2d[float],  # (M, columns)
    total: wp.array[int],  # (1,)
    asked: Product,
    # outputs
    dst: wp.array2d[float],  # (M, >= columns)
):
    multiply(first, last, src, w, gates, total, asked, dst)


@_native.func_native("_layers_cpu.h", LANES=LANES, ROWS=ROWS)
def accumulate(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],
    src: wp.array2d[float],
    total: wp.array[int],
    column: int,
    columns: int,
    parts: wp.array3d[float],
): ...


@wp.kernel
def outer(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (M, >= columns)
    src: wp.array2d[float],  # (M, >= K)
    total: wp.array[int],  # (1,)
    column: int,
    columns: int,
    # outputs
    parts: wp.array3d[float],  # (slabs, K, N padded to a multiple of LANES)
):
    accumulate(slab, first, last, dy, src, total, column, columns, parts)


@wp.kernel
def gather(
    parts: wp.array3d[float],  # (slabs, K, N padded to a multiple of LANES)
    # outputs
    dw: wp.array2d[float],  # (K, N): added to
):
    k = wp.tid()
    for n in range(dw.shape[1]):
        for slab in range(parts.shape[0]):
            dw[k, n] = dw[k, n] + parts[slab, k, n]


@wp.kernel
def pad(
    w: wp.array2d[float],  # (K, N)
    transposed: bool,
    # outputs
    padded: wp.array2d[float],  # w or its transpose, with columns of 0
):
    k = wp.tid()
    columns = w.shape[1]
    if transposed:
        columns = w.shape[0]
    for n in range(padded.shape[1]):
        value = float(0.0)
        if n < columns:
            if transposed:
                value = w[n, k]
            else:
                value = w[k, n]
        padded[k, n] = value
