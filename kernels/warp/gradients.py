"""Gradients in Warp: over lanes on the CPU, over blocks of outputs on CUDA."""

import warp as wp

from . import _filters_blocks as filter_blocks
from . import _gradients_blocks as blocks
from . import _gradients_lanes as lanes
from ._lanes import LANES, f32_lanes, padded, unpad, vectors
from ._launch import launch, launch_slabs, scratch, slabs


def differentiate(
    src: wp.array,
    smooth: wp.array,
    slope: wp.array,
    border: int,
    cval: float,
    cval_smooth: float,
    cval_slope: float,
    dy: wp.array,
    dx: wp.array,
) -> None:
    """Correlate with slope down the rows and smooth along the columns (dy), and crosswise (dx)."""
    if src.device.is_cuda:
        planes = (1, *src.shape)
        middle = scratch("differentiate.middle", planes, wp.float32, src.device)
        image = src.reshape(planes)
        filter_blocks.correlate_columns(image, slope, border, cval, middle)
        filter_blocks.correlate_rows(middle, smooth, 1, border, cval_slope, dy.reshape(planes))
        filter_blocks.correlate_columns(image, smooth, border, cval, middle)
        filter_blocks.correlate_rows(middle, slope, 1, border, cval_smooth, dx.reshape(planes))
        return
    height, columns = src.shape
    wide_src, wide_dy, wide_dx = (
        padded(a, f"differentiate.{i}") for i, a in enumerate((src, dy, dx))
    )
    count = slabs(height, src.size)
    stored = wide_src.shape[1]
    line = (count, stored + smooth.shape[0] - 1)
    smoothed = scratch("differentiate.smoothed", line, wp.float32, src.device)
    sloped = scratch("differentiate.sloped", line, wp.float32, src.device)
    launch_slabs(
        lanes.differentiate,
        height,
        count,
        [
            vectors(wide_src, f32_lanes),
            stored,
            columns,
            smooth,
            slope,
            border,
            cval,
            cval_smooth,
            cval_slope,
            smoothed,
            vectors(smoothed, f32_lanes),
            sloped,
            vectors(sloped, f32_lanes),
        ],
        [vectors(wide_dy, f32_lanes), vectors(wide_dx, f32_lanes)],
    )
    unpad(wide_dy, dy)
    unpad(wide_dx, dx)


def polar(dy: wp.array, dx: wp.array, magnitude: wp.array, orientation: wp.array) -> None:
    """Length and angle of each (dy, dx)."""
    _each(blocks.polar, lanes.polar, [dy, dx], [magnitude, orientation])


def root_mean_square(dy: wp.array, dx: wp.array, dst: wp.array) -> None:
    """``sqrt((dy^2 + dx^2) / 2)`` of each pair."""
    _each(blocks.root_mean_square, lanes.root_mean_square, [dy, dx], [dst])


def _each(
    on_cuda: wp.Kernel, on_cpu: wp.Kernel, inputs: list[wp.array], outputs: list[wp.array]
) -> None:
    """Launch a kernel that takes each element by itself."""
    size = inputs[0].size
    if inputs[0].device.is_cuda:
        flat = (size,)
        launch(on_cuda, size, [a.reshape(flat) for a in inputs], [a.reshape(flat) for a in outputs])
        return
    given = [a.reshape((1, size)) for a in (*inputs, *outputs)]
    wide = [padded(a, f"each.{i}") for i, a in enumerate(given)]
    views = [vectors(a, f32_lanes) for a in wide]
    n = len(inputs)
    launch_slabs(on_cpu, -(-size // LANES), slabs(size, size), views[:n], views[n:])
    for a, b in zip(wide[n:], given[n:], strict=True):
        unpad(a, b)
