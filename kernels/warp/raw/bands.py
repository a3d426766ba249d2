"""Bands of a local Laplacian filter, in Warp; the Taichi set has the equations."""

from collections.abc import Sequence
from itertools import pairwise

import warp as wp

from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp._spans import spans
from cvkern.kernels.warp.raw import _bands_cuda as cuda


def begin(
    logs: wp.array, lowest: float, step: float, sigma: float, slope: float, dst: wp.array
) -> None:
    """Write the first smaller level of the image remapped about each reference, and of its own."""
    planes, rows, columns = dst.shape
    inputs = [logs, lowest, step, sigma, slope]
    if dst.device.is_cuda:
        groups = (planes - 2) // cuda.MANY + 1
        blocks = cuda.BLOCKS * dst.device.sm_count
        each = cuda.rows_at_once(groups, rows, columns, blocks)
        threads = cuda.warps(groups, rows, columns, each)
        launch(cuda.begin_strips, threads, [*inputs, each], [dst])
        return
    _begin.launch(rows, columns, 20 * planes * rows * columns, inputs, [dst])


def reduce(levels: Sequence[wp.array], planes: int) -> None:
    """Make the first planes of each level from the next larger one, which comes before it.

    They are smoothed, and every second row and column is kept.
    """
    if not levels[0].device.is_cuda:
        for src, dst in pairwise(levels):
            _, rows, columns = dst.shape
            _reduce.launch(planes * rows, columns, 4 * planes * rows * columns, [src], [dst])
        return
    own = cuda.rest(levels[1:])
    for src, dst in pairwise(levels[: own + 1]):
        _, rows, columns = dst.shape
        each = cuda.rows_each(planes, rows, columns)
        threads = cuda.warps(planes, rows, columns, each)
        launch(cuda.reduce_strips, threads, [planes, src, each], [dst])
    src, *others = levels[own:]
    if others:
        outputs = cuda.filled(others, cuda.MOST_LEVELS)
        threads = planes * cuda.THREADS
        launch(cuda.reduce_rest, threads, [planes, len(others), src], outputs, cuda.THREADS)


def collapse(
    levels: Sequence[wp.array],
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    out: wp.array,
) -> None:
    """Add the bands of all levels, between references, from the smallest to the image itself.

    The first level is the image, of one plane. The smallest counts by `slope`, as it is. Results
    stand in the last plane of each level, and of the image in `out`.
    """
    inner, below, share = [*levels[1:]], levels[-1].shape[0] - 2, slope
    if out.device.is_cuda:
        small = inner[min(cuda.rest(inner), len(inner) - 1) :]
        if len(small) > 1:
            outputs = cuda.filled(small, cuda.MOST_LEVELS + 1)
            inputs = [len(small), lowest, step, slope]
            launch(cuda.collapse_rest, cuda.FEWER, inputs, outputs, cuda.FEWER)
            inner = inner[: 1 - len(small)]
            below, share = below + 1, 1.0
    for coarse, fine in pairwise([*inner[::-1], levels[0]]):
        first = fine is levels[0]
        to = out if first else fine
        _, rows, columns = to.shape
        inputs = [fine, coarse, below, share, lowest, step, sigma if first else 0.0, slope]
        if out.device.is_cuda:
            squares = -(-rows // 2) * -(-columns // 2)
            launch(cuda.collapse_four, cuda.threads(squares), inputs, [to])
        else:
            _collapse.launch(rows, columns, 40 * rows * columns, inputs, [to])
        below, share = levels[-1].shape[0] - 1, 1.0


@spans("_bands.h")
def _begin(
    row: int,
    left: int,
    right: int,
    logs: wp.array2d[float],
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    dst: wp.array3d[float],
): ...


@spans("_bands.h")
def _reduce(
    row: int,
    left: int,
    right: int,
    src: wp.array3d[float],
    dst: wp.array3d[float],
): ...


@spans("_bands.h")
def _collapse(
    row: int,
    left: int,
    right: int,
    fine: wp.array3d[float],
    coarse: wp.array3d[float],
    below: int,
    share: float,
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    out: wp.array3d[float],
): ...
