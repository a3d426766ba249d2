"""From edge points to circles, in Warp.

Each edge point has a line: its place between the pixels, and the direction of its gradient. Lines
vote for centres, in cells; points near a centre vote for radii; and the points near a circle give
the sums of a least-squares fit.
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

from . import _detection_cpu as cpu
from . import _detection_cuda as cuda

_SLAB_POINTS = 1 << 12  # for fewer, an accumulator more costs more than a thread gains
_SLAB_TESTS = 1 << 18

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def _length(dy: wp.array2d[float], dx: wp.array2d[float], y: int, x: int) -> float:
    """Length of the gradient, 0 outside the image."""
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
    # Between the pixels, the edge is at the top of the parabola through the lengths of the gradient
    # along the axis that it is nearest to.
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
    """Average squares of `factor` pixels a side of a uint8 or float32 image."""
    if src.device.is_cuda:
        launch(cuda.shrinks[src.dtype], dst.size, [src, factor], [dst])
        return
    height = dst.shape[0]
    count = slabs(height, src.size)
    lines = scratch("shrink.lines", (count, src.shape[1]), wp.float32, src.device)
    launch_slabs(cpu.shrinks[src.dtype], height, count, [src, factor, lines], [dst])


def aim(dy: wp.array, dx: wp.array, pixels: wp.array, lines: wp.array) -> None:
    """Write row and column of the edge at each of N pixels, and its direction's sine and cosine."""
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
    """Count in each cell the lines that reach it after `low` to `high` steps; write all votes.

    `scale` is 2^15 over the side of a cell. Sides are 1, along the gradient, and -1, from the
    first down to the last.
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
    """Count, by distance, the points that aim at each centre; write all histograms.

    A point at a distance in [least, most] counts, if it aims at the centre.
    """
    inputs = [lines, centers, least, most, per_bin]
    if lines.device.is_cuda:
        launch(cuda.clear_integers, histograms.size, [], [histograms.reshape((histograms.size,))])
        launch(cuda.vote_radii, centers.shape[0] * lines.shape[1], [*inputs, *aim], [histograms])
        return
    count = centers.shape[0]
    inputs.append(cpu.sight(*aim))
    launch_slabs(cpu.vote_radii, count, _parts(count, lines), inputs, [histograms])


def support(
    lines: wp.array,
    circles: wp.array,
    band: float,
    aim: Aim,
    sums: wp.array,
    arcs: wp.array,
) -> None:
    """Add up what a least-squares fit needs of the points near each circle, and count its arcs.

    With normal n in 2^-14 and distance e from the circle in 2^-10, the sums are those of ny ny,
    ny nx, nx nx, ny, nx, 1, e ny, e nx and e.
    """
    inputs = [lines, circles, band]
    if lines.device.is_cuda:
        launch(cuda.clear_sums, sums.size, [], [sums.reshape((sums.size,))])
        launch(cuda.clear_integers, arcs.size, [], [arcs.reshape((arcs.size,))])
        launch(cuda.support, circles.shape[0] * lines.shape[1], [*inputs, *aim], [sums, arcs])
        return
    count = circles.shape[0]
    inputs.append(cpu.sight(*aim))
    launch_slabs(cpu.support, count, _parts(count, lines), inputs, [sums, arcs])


def _parts(count: int, lines: wp.array) -> int:
    return max(1, min(cpu_threads(), count, count * lines.shape[1] // _SLAB_TESTS))
