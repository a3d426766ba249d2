"""Layers of a perceptron in Warp: float16 on CUDA's tensor cores, else float32."""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp.radiance import _sums_cuda as parts_cuda

from . import _layers_cpu as cpu
from . import _layers_cuda as cuda
from ._product import product_of

_BLOCKS = 132 * 2  # two per multiprocessor of the largest GPUs, so that one works while one waits


def forward(
    x: wp.array, w: wp.array, total: wp.array, relu: bool, column: int, y: wp.array
) -> None:
    """Compute ``y[:, column:column + N] = x w`` for the first `total` (1,) rows, >= 0 if `relu`.

    `x` is (M, >= K), `w` (K, N) and `y` (M, >= column + N); K and N are multiples of 16.
    """
    _product(x, w, x, total, False, 0, column, relu, False, y)


def backward_input(
    dy: wp.array, w: wp.array, x: wp.array, total: wp.array, gated: bool, column: int, dx: wp.array
) -> None:
    """``dx = dy[:, column:column + N] w^T``, from y = x w, for the first `total` (1,) rows.

    If `gated`, `x` (M, K) is the output of a layer with `relu`, and `dx` (M, K) is 0 where `x` is
    0.
    """
    _product(dy, w, x, total, True, column, 0, False, gated, dx)


def backward_weight(dy: wp.array, x: wp.array, total: wp.array, column: int, dw: wp.array) -> None:
    """``dw += x^T dy[:, column:column + N]``, from y = x w, over the first `total` (1,) rows.

    `x` is (M, >= K), `dw` (K, N) float32. On CUDA the order of the sums is always the same; on the
    CPU it depends only on the number of threads.
    """
    depth, columns = dw.shape
    if dw.device.is_cuda:
        tile = cuda.tile(depth), cuda.tile(columns)
        tiles = depth // tile[0] * (columns // tile[1])
        count = max(1, _BLOCKS // 2 // tiles)
        parts = scratch("dense.parts", (count, depth, columns), wp.float32, dw.device)
        threads = count * tiles * BLOCK
        launch(cuda.outer(*tile), threads, [dy, x, total, column], [parts])
        size = depth * columns
        parts, sums = view(parts, wp.float32, (count, size)), view(dw, wp.float32, (size,))
        launch(parts_cuda.gather, parts_cuda.threads(size), [parts], [sums])
        return
    count = slabs(x.shape[0], x.shape[0] * columns * 8)
    padded = -(-columns // cpu.LANES) * cpu.LANES
    parts = scratch("dense.parts", (count, depth, padded), wp.float32, dw.device)
    launch_slabs(cpu.outer, x.shape[0], count, [dy, x, total, column, columns], [parts])
    launch(cpu.gather, depth, [parts], [dw])


def _product(
    src: wp.array,
    w: wp.array,
    gates: wp.array,
    total: wp.array,
    transposed: bool,
    column_in: int,
    column_out: int,
    relu: bool,
    gated: bool,
    dst: wp.array,
) -> None:
    """Compute ``dst = src w`` or ``src w^T``; 0 where `gates` are 0 if `gated`."""
    depth, columns = w.shape[::-1] if transposed else w.shape
    product = product_of(columns, column_in, column_out, relu, gated)
    if dst.device.is_cuda:
        tile = cuda.tile(columns)
        count = max(1, _BLOCKS // (columns // tile)) * (columns // tile)
        launch(
            cuda.product(depth, tile, transposed),
            count * BLOCK,
            [src, w, gates, total, product],
            [dst],
        )
        return
    padded = -(-columns // cpu.LANES) * cpu.LANES
    weights = scratch("dense.weights", (depth, padded), wp.float32, w.device)
    launch(cpu.pad, depth, [w, transposed], [weights])
    launch_slabs(
        cpu.product,
        src.shape[0],
        slabs(src.shape[0], src.shape[0] * columns * 8),
        [src, weights, gates, total, product],
        [dst],
    )
