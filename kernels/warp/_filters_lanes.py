"""Linear filters on the CPU: one thread a slab of rows, a vector of pixels at a time."""

import warp as wp

from ._lanes import LANES, f32_lanes
from ._separable import fill_margins, sum_along, sum_down

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def correlate_separable(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[f32_lanes],  # (P H, N)
    stored: int,  # N
    height: int,  # H
    columns: int,  # W step <= N
    taps_y: wp.array[float],  # (2 ry + 1,)
    taps_x: wp.array[float],  # (2 rx + 1,)
    step: int,
    border: int,
    cval: float,
    # scratch
    line: wp.array2d[float],  # (slabs, rx step + N + rx step)
    line_lanes: wp.array2d[f32_lanes],
    # outputs
    dst: wp.array2d[f32_lanes],  # (P H, N)
):
    margin = taps_x.shape[0] // 2 * step
    count = (stored + LANES - 1) // LANES
    for row in range(first, last):
        y = row % height
        for lane in range(count):
            x = wp.min(lane * LANES, stored - LANES)
            line_lanes[slab, margin + x] = sum_down(
                src, row - y, y, height, x, taps_y, border, cval
            )
        fill_margins(line, slab, margin, columns, step, border, cval)
        for lane in range(count):
            x = wp.min(lane * LANES, stored - LANES)
            dst[row, x] = sum_along(line_lanes, slab, x, step, taps_x)
