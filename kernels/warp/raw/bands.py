"""Bands of a local Laplacian filter, in Warp; the Taichi set has the equations."""

import warp as wp

from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp._spans import spans
from cvkern.kernels.warp.raw import _bands_cuda


def begin(
    logs: wp.array, lowest: float, step: float, sigma: float, slope: float, dst: wp.array
) -> None:
    """Write the first smaller level of the image remapped about each reference, and of its own."""
    planes, rows, columns = dst.shape
    inputs = [logs, lowest, step, sigma, slope]
    if dst.device.is_cuda:
        groups = (planes - 2) // _bands_cuda.MANY + 1
        threads = _bands_cuda.warps(groups, rows, columns, _bands_cuda.LONG)
        launch(_bands_cuda.begin_strips, threads, inputs, [dst])
        return
    _begin.launch(rows, columns, 20 * planes * rows * columns, inputs, [dst])


def reduce(src: wp.array, planes: int, dst: wp.array) -> None:
    """Smooth the first planes, and keep every second row and column."""
    _, rows, columns = dst.shape
    if dst.device.is_cuda:
        each = _bands_cuda.rows_each(planes, rows, columns)
        threads = _bands_cuda.warps(planes, rows, columns, each)
        launch(_bands_cuda.reduce_strips, threads, [planes, src, each], [dst])
        return
    work = 4 * planes * rows * columns
    _reduce.launch(planes * rows, columns, work, [src], [dst])


def collapse(
    fine: wp.array,
    coarse: wp.array,
    below: int,
    share: float,
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    out: wp.array,
) -> None:
    """Add the bands of a level, between references, to plane `below` of the smaller level.

    That plane counts by its share. The result is the last plane of `out`. With `sigma` above 0, the
    level is the image itself, of one plane.
    """
    _, rows, columns = out.shape
    inputs = [fine, coarse, below, share, lowest, step, sigma, slope]
    if out.device.is_cuda:
        squares = -(-rows // 2) * -(-columns // 2)
        launch(_bands_cuda.collapse_four, _bands_cuda.threads(squares), inputs, [out])
        return
    _collapse.launch(rows, columns, 40 * rows * columns, inputs, [out])


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
