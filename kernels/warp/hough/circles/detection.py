"""From edge points to circles, in Warp.

Each edge point has a line, given by its sub-pixel position and the direction of its gradient. Lines
vote for centres, in cells. Points near a centre vote for radii. The points near a circle give the
sums of a least-squares fit. On the CPU a thread takes a slab of points, centres or circles; on CUDA
it takes a point.
"""

import warp as wp

from cvkern.kernels.codes.hough import Aim
from cvkern.kernels.warp._launch import (
    cpu_threads,
    launch,
    launch_each,
    launch_slabs,
    scratch,
    slabs,
)
from cvkern.kernels.warp._structs import struct_of

from . import _detection_cpu as cpu
from . import _detection_cuda as cuda

_SLAB_POINTS = 1 << 12  # with fewer points, another accumulator costs more than its thread gains
_SLAB_TESTS = 1 << 18

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def _length(dy: wp.array2d[float], dx: wp.array2d[float], y: int, x: int) -> float:
    """Return the length of the gradient, 0 outside the image."""
    if y < 0 or x < 0 or y >= dy.shape[0] or x >= dy.shape[1]:
        return 0.0
    return wp.sqrt(dx[y, x] * dx[y, x] + dy[y, x] * dy[y, x])


@wp.kernel
def _aim(
    stride: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    pixels: wp.array2d[int],  # (N, 2)
    # outputs
    lines: wp.array2d[float],  # (4, N)
):
    # The sub-pixel edge is at the maximum of the parabola through three lengths of the gradient,
    # along the axis nearest to the gradient.
    for i in range(first + wp.tid(), last, stride):
        y = pixels[i, 0]
        x = pixels[i, 1]
        steep = wp.where(wp.abs(dy[y, x]) > wp.abs(dx[y, x]), 1, 0)
        flat = 1 - steep
        before = _length(dy, dx, y - steep, x - flat)
        here = _length(dy, dx, y, x)
        behind = _length(dy, dx, y + steep, x + flat)
        offset = float(0.0)
        if here > before and here >= behind:
            offset = 0.5 * (before - behind) / (before - 2.0 * here + behind)
        lines[0, i] = float(y) + wp.where(steep == 1, offset, 0.0)
        lines[1, i] = float(x) + wp.where(steep == 1, 0.0, offset)
        lines[2, i] = dy[y, x] / here
        lines[3, i] = dx[y, x] / here


def shrink(src: wp.array, factor: int, dst: wp.array) -> None:
    """Average squares of `factor` x `factor` pixels of a uint8 or float32 image."""
    if src.device.is_cuda:
        launch(cuda.shrinks[src.dtype], dst.size, [src, factor], [dst])
        return
    height = dst.shape[0]
    count = slabs(height, src.size)
    lines = scratch("shrink.lines", (count, src.shape[1]), wp.float32, src.device)
    launch_slabs(cpu.shrinks[src.dtype], height, count, [src, factor, lines], [dst])


def aim(dy: wp.array, dx: wp.array, pixels: wp.array, lines: wp.array) -> None:
    """Write row, column, sine and cosine of direction of the sub-pixel edge at each of N pixels."""
    count = lines.shape[1]
    launch_each(_aim, count, count, [dy, dx, pixels], [lines])


def vote_centers(
    lines: wp.array,
    low: int,
    high: int,
    scale: float,
    first_side: int,
    last_side: int,
    votes: wp.array,
) -> None:
    """Count in each cell the lines that reach it after `low` to `high` steps; fill all votes.

    `scale` is 2^15 divided by the side of a cell. Side 1 is along the gradient, -1 against it; the
    sides run from the first down to the last.
    """
    inputs = [lines, low, high, scale, first_side, last_side]
    if lines.device.is_cuda:
        launch(cuda.clear, votes.size, [], [votes.reshape((votes.size,))])
        launch(cuda.vote_centers, lines.shape[1], inputs, [votes])
        return
    count = lines.shape[1]
    parts = max(1, min(cpu_threads(), count // _SLAB_POINTS))
    planes = scratch("centers.parts", (parts, *votes.shape), wp.int32, lines.device)
    launch_slabs(cpu.vote_centers, count, parts, inputs, [planes])
    launch(cpu.add_parts, 1, [planes], [votes])


def vote_radii(
    lines: wp.array,
    centers: wp.array,
    least: float,
    most: float,
    per_bin: float,
    aim: Aim,
    histograms: wp.array,
) -> None:
    """Count, by distance, the points that aim at each centre; fill all histograms.

    A point counts if its distance is in [least, most] and it aims at the centre.
    """
    inputs = [lines, centers, least, most, per_bin]
    if lines.device.is_cuda:
        launch(cuda.clear_integers, histograms.size, [], [histograms.reshape((histograms.size,))])
        launch(cuda.vote_radii, centers.shape[0] * lines.shape[1], [*inputs, *aim], [histograms])
        return
    count = centers.shape[0]
    inputs.append(struct_of(cpu.Sight, aim))
    launch_slabs(cpu.vote_radii, count, _parts(count, lines), inputs, [histograms])


def support(
    lines: wp.array,
    circles: wp.array,
    band: float,
    aim: Aim,
    sums: wp.array,
    arcs: wp.array,
) -> None:
    """Compute the sums of a least-squares fit for each circle, and count points by arc.

    The sums are those of ny ny, ny nx, nx nx, ny, nx, 1, e ny, e nx and e, where n is the normal in
    units of 2^-14 and e the distance from the circle in units of 2^-10.
    """
    inputs = [lines, circles, band]
    if lines.device.is_cuda:
        launch(cuda.clear_sums, sums.size, [], [sums.reshape((sums.size,))])
        launch(cuda.clear_integers, arcs.size, [], [arcs.reshape((arcs.size,))])
        launch(cuda.support, circles.shape[0] * lines.shape[1], [*inputs, *aim], [sums, arcs])
        return
    count = circles.shape[0]
    inputs.append(struct_of(cpu.Sight, aim))
    launch_slabs(cpu.support, count, _parts(count, lines), inputs, [sums, arcs])


def _parts(count: int, lines: wp.array) -> int:
    return max(1, min(cpu_threads(), count, count * lines.shape[1] // _SLAB_TESTS))
