"""Linear filters on the CPU: one thread a slab of rows, a vector of pixels at a time."""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide

from ._separable_cpu import fill_margins, pair_down, sum_along, sum_down

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
    line: wp.array2d[float],  # (2 slabs, rx step + N + rx step)
    line_lanes: wp.array2d[f32_lanes],
    line_wide: wp.array2d[f32_wide],
    # outputs
    dst: wp.array2d[f32_wide],  # (P H, N)
):
    margin = taps_x.shape[0] // 2 * step
    count = (stored + LANES - 1) // LANES
    row = int(first)
    while row < last:
        y = row % height
        pair = row + 1 < last and y >= taps_y.shape[0] // 2
        pair = pair and y + 1 + taps_y.shape[0] // 2 < height
        for lane in range(count):
            x = wp.min(lane * LANES, stored - LANES)
            if pair:
                pair_down(src, row, x, taps_y, line_lanes, 2 * slab, margin + x)
            else:
                line_lanes[2 * slab, margin + x] = sum_down(
                    src, row - y, y, height, x, taps_y, border, cval
                )
        for k in range(wp.where(pair, 2, 1)):
            fill_margins(line, 2 * slab + k, margin, columns, step, border, cval)
            for lane in range((stored + WIDE - 1) // WIDE):
                x = wp.min(lane * WIDE, stored - WIDE)
                dst[row + k, x] = sum_along(line_wide, 2 * slab + k, x, step, taps_x)
        row += wp.where(pair, 2, 1)
