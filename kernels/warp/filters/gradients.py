"""Gradients in Warp: over lanes on the CPU, over blocks of outputs on CUDA.

A derivative is a difference in one direction and a smoothing in the other. The length is
``sqrt(dx^2 + dy^2)``, and the angle that of (dx, dy).
"""

import warp as wp

from cvkern.kernels.codes.filters import Outside
from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide, padded, unpad, vectors
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs, view

from . import _gradients as each
from . import _gradients_cpu as cpu
from . import _gradients_cuda as cuda
from . import _linear_cuda as filter_cuda
from ._separable_cpu import lines


def differentiate(
    src: wp.array,
    smooth: wp.array,
    slope: wp.array,
    outside: Outside,
    dy: wp.array,
    dx: wp.array,
) -> None:
    """Correlate with slope down the rows and smooth along the columns (dy), or exchanged (dx)."""
    _differentiate(src, smooth, slope, outside, [dy, dx])


def differentiate_polar(
    src: wp.array,
    smooth: wp.array,
    slope: wp.array,
    outside: Outside,
    dy: wp.array,
    dx: wp.array,
    magnitude: wp.array,
    orientation: wp.array,
) -> None:
    """Differentiate, and compute the length and the angle of each (dy, dx) as well."""
    outputs = [dy, dx, magnitude, orientation]
    _differentiate(src, smooth, slope, outside, outputs)


def _differentiate(
    src: wp.array,
    smooth: wp.array,
    slope: wp.array,
    outside: Outside,
    outputs: list[wp.array],
) -> None:
    """Fill dy and dx, and magnitude and orientation if they are given; (H, W) or (N, H, W)."""
    polar = len(outputs) == 4
    if src.device.is_cuda:
        planes = (1, *src.shape)[-3:]
        middle = scratch("differentiate.middle", planes, wp.float32, src.device)
        image, dy, dx = (view(a, wp.float32, planes) for a in (src, *outputs[:2]))
        border, cval, cval_smooth, cval_slope = outside
        filter_cuda.correlate_columns(image, slope, border, cval, middle)
        filter_cuda.correlate_rows(middle, smooth, 1, border, cval_slope, dy)
        filter_cuda.correlate_columns(image, smooth, border, cval, middle)
        filter_cuda.correlate_rows(middle, slope, 1, border, cval_smooth, dx)
        if polar:
            flat = _flat(*outputs)
            launch(cuda.polar, src.size, flat[:2], flat[2:])
        return
    if src.ndim == 3:
        for i in range(src.shape[0]):
            _differentiate(src[i], smooth, slope, outside, [a[i] for a in outputs])
        return
    height, columns = src.shape
    wide_src = padded(src, "differentiate.src", WIDE)
    wide = [padded(a, f"differentiate.{i}", WIDE) for i, a in enumerate(outputs)]
    count = slabs(height, src.size)
    margin = smooth.shape[0] // 2
    line = lines("differentiate.line", 4 * count, wide_src.shape[1], margin, src.device)
    launch_slabs(
        cpu.differentiate,
        height,
        count,
        [vectors(wide_src, f32_lanes), smooth, slope, cpu.outside_of(columns, outside), line],
        _planes(wide) if polar else [*_planes(wide), None, None],
    )
    for a, b in zip(wide, outputs, strict=True):
        unpad(a, b)


def polar(dy: wp.array, dx: wp.array, magnitude: wp.array, orientation: wp.array) -> None:
    """Compute the length and the angle of each (dy, dx)."""
    size = dy.size
    if dy.device.is_cuda:
        launch(cuda.polar, size, _flat(dy, dx), _flat(magnitude, orientation))
        return
    rows = size // dy.shape[-1]
    given = [view(a, wp.float32, (rows, dy.shape[-1])) for a in (dy, dx, magnitude, orientation)]
    wide = [padded(a, f"polar.{i}", WIDE) for i, a in enumerate(given)]
    views = _planes(wide)
    launch_slabs(cpu.polar, rows, slabs(rows, size), views[:2], views[2:])
    for a, b in zip(wide[2:], given[2:], strict=True):
        unpad(a, b)


def root_mean_square(dy: wp.array, dx: wp.array, dst: wp.array) -> None:
    """Compute ``sqrt((dy^2 + dx^2) / 2)`` of each pair."""
    size = dy.size
    if dy.device.is_cuda:
        launch(cuda.root_mean_square, size, _flat(dy, dx), _flat(dst))
        return
    _in_lanes(cpu.root_mean_square, dy, dx, dst)


def add(dy: wp.array, dx: wp.array, dst: wp.array) -> None:
    """Compute ``dy + dx`` of each pair."""
    if dst.device.is_cuda:
        launch_each(each.add, dst.size, dst.size, _flat(dy, dx), _flat(dst))
    else:
        _in_lanes(cpu.add, dy, dx, dst)


def _in_lanes(kernel: wp.Kernel, dy: wp.array, dx: wp.array, dst: wp.array) -> None:
    """Launch a kernel of pairs on the CPU, over lanes."""
    size = dst.size
    given = [view(a, wp.float32, (1, size)) for a in (dy, dx, dst)]
    wide = [padded(a, f"{kernel.key}.{i}") for i, a in enumerate(given)]
    views = [vectors(a, f32_lanes) for a in wide]
    lanes_of_all = -(-size // LANES)
    launch_slabs(kernel, lanes_of_all, slabs(lanes_of_all, size), views[:2], views[2:])
    unpad(wide[2], given[2])


def confine(mask: wp.array, dst: wp.array) -> None:
    """Set pixels to 0 where they or one of their eight neighbours are masked or outside."""
    planes = (1, *dst.shape)[-3:]
    masks = view(mask, wp.uint8, planes)
    launch_each(each.confine, dst.size, dst.size, [masks], [view(dst, wp.float32, planes)])


def _flat(*arrays: wp.array) -> list[wp.array]:
    return [view(a, wp.float32, (a.size,)) for a in arrays]


def _planes(wide: list[wp.array]) -> list[wp.array]:
    """Return images as planes of vectors."""
    return [vectors(view(a, wp.float32, (1, *a.shape)), f32_wide) for a in wide]
