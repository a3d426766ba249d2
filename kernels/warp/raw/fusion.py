"""Fusion of exposures, in Warp; the Taichi set has the equations."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp._spans import Spans, spans
from cvkern.kernels.warp.raw import _bands_cuda as cuda
from cvkern.kernels.warp.raw._fusion_cuda import QUICK_BLOCKS, kernels, names


def weigh(
    frames: wp.array,
    scale: float,
    contrast: float,
    saturation: float,
    exposure: float,
    weights: wp.array,
) -> None:
    """Write the shares (K, H, W) of frames (K, H, W, C) at each pixel.

    `exposure` is times the square of a value's distance from 1/2, as a power of 2.
    """
    _, rows, columns = weights.shape
    inputs = [frames, scale, contrast, saturation, exposure]
    if weights.device.is_cuda:
        squares = -(-rows // 2) * -(-columns // 4)
        launch(
            kernels(frames.dtype, frames.shape[3]).weigh, cuda.threads(squares), inputs, [weights]
        )
        return
    kernel = _weigh(frames.dtype, frames.shape[3])
    kernel.launch(rows, columns, 10 * weights.size, inputs, [weights])


def begin(frames: wp.array, scale: float, weights: wp.array, dst: wp.array) -> None:
    """Write the first smaller level of the channels and of the weights, K times C + 1 planes.

    C planes more are for the result.
    """
    count, (_, rows, columns) = frames.shape[0], dst.shape
    inputs = [frames, scale, weights]
    if dst.device.is_cuda:
        made = kernels(frames.dtype, frames.shape[3])
        quick = frames.dtype is wp.uint8 and frames.shape[2] % 4 == 0 and frames.ptr % 4 == 0
        begin = made.quick if quick else made.begin
        each = cuda.rows_each(count, rows, columns)
        if quick:
            blocks = QUICK_BLOCKS * dst.device.sm_count
            each = cuda.rows_at_once(count, rows, columns, blocks)
        launch(begin, cuda.warps(count, rows, columns, each), [*inputs, each], [dst])
        return
    kernel = _begin(frames.dtype, frames.shape[3])
    kernel.launch(count * rows, columns, 4 * dst.size, inputs, [dst])


def blend(levels: Sequence[wp.array], channels: int) -> None:
    """Add the weighted bands of each level to the result of the next smaller one, enlarged.

    Results are the last planes of a level, one for each channel. The smallest level is its own
    band.
    """
    own = len(levels)
    if levels[0].device.is_cuda:
        made, own = kernels(wp.float32, channels), cuda.rest(levels)
        if own < len(levels):
            outputs = cuda.filled(levels[own:], cuda.MOST_LEVELS)
            inputs = [len(levels) - own]
            launch(made.rest, channels * cuda.FEWER, inputs, outputs, cuda.FEWER)
    for n in reversed(range(own)):
        alone = n + 1 == len(levels)
        fine, inputs = levels[n], [levels[n if alone else n + 1], int(alone)]
        _, rows, columns = fine.shape
        if fine.device.is_cuda:
            squares = channels * -(-rows // 2) * -(-columns // 2)
            launch(kernels(wp.float32, channels).blend, cuda.threads(squares), inputs, [fine])
        else:
            _blend(channels).launch(rows, columns, 4 * fine.size, inputs, [fine])


def finish(
    frames: wp.array,
    scale: float,
    weights: wp.array,
    coarse: wp.array,
    alone: int,
    out: wp.array,
) -> None:
    """Add the bands of the frames themselves, and bend values into 0 to 1: (H, W, C).

    Frames that stand `alone` have no smaller level.
    """
    rows, columns, channels = out.shape
    inputs = [frames, scale, weights, coarse, alone]
    if out.device.is_cuda:
        warps = -(-rows // 2) * -(-columns // (2 * cuda.LANES))
        launch(kernels(frames.dtype, channels).finish, cuda.threads(32 * warps), inputs, [out])
        return
    kernel = _finish(frames.dtype, channels)
    kernel.launch(rows, columns, 4 * frames.size, inputs, [out])


@lru_cache
def _weigh(scalar: Any, channels: int) -> Spans:
    @spans("_fusion.h", **names(scalar, channels))
    def _weigh(
        row: int,
        left: int,
        right: int,
        frames: wp.array4d[scalar],
        scale: float,
        contrast: float,
        saturation: float,
        exposure: float,
        weights: wp.array3d[float],
    ): ...

    return _weigh


@lru_cache
def _begin(scalar: Any, channels: int) -> Spans:
    @spans("_fusion.h", **names(scalar, channels))
    def _begin(
        row: int,
        left: int,
        right: int,
        frames: wp.array4d[scalar],
        scale: float,
        weights: wp.array3d[float],
        dst: wp.array3d[float],
    ): ...

    return _begin


@lru_cache
def _blend(channels: int) -> Spans:
    @spans("_fusion.h", **names(wp.float32, channels))
    def _blend(
        row: int,
        left: int,
        right: int,
        coarse: wp.array3d[float],
        alone: int,
        fine: wp.array3d[float],
    ): ...

    return _blend


@lru_cache
def _finish(scalar: Any, channels: int) -> Spans:
    @spans("_fusion.h", **names(scalar, channels))
    def _finish(
        row: int,
        left: int,
        right: int,
        frames: wp.array4d[scalar],
        scale: float,
        weights: wp.array3d[float],
        coarse: wp.array3d[float],
        alone: int,
        out: wp.array3d[float],
    ): ...

    return _finish
