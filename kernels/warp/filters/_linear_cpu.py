"""Linear filters on the CPU: one thread per slab of rows, one vector of pixels at a time.

Each row is correlated down the rows into a line of scratch, and then along the line. Two rows whose
windows lie inside the image are processed together, because they share most of the pixels that they
read.
"""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide

from ._separable_cpu import Lines, fill_margins, pair_down, sum_along, sum_down

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def correlate_separable(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[f32_lanes],  # (P H, N - 31)
    columns: int,  # W step <= N
    taps_y: wp.array[float],  # (2 ry + 1,)
    taps_x: wp.array[float],  # (2 rx + 1,)
    step: int,
    border: int,
    cval: float,
    # scratch
    lines: Lines,  # (2 slabs, rx step + N + rx step)
    # outputs
    dst: wp.array3d[f32_wide],  # (P, H, N - 63)
):
    height = dst.shape[1]
    stored = dst.shape[2] + WIDE - 1
    reach = taps_y.shape[0] // 2
    margin = taps_x.shape[0] // 2 * step
    row = int(first)
    while row < last:
        plane = row // height
        y = row - plane * height
        pair = row + 1 < last and y >= reach and y + 1 + reach < height
        for lane in range((stored + LANES - 1) // LANES):
            x = wp.min(lane * LANES, stored - LANES)
            if pair:
                pair_down(src, row, x, taps_y, lines.lanes, 2 * slab, margin + x)
            else:
                lines.lanes[2 * slab, margin + x] = sum_down(
                    src, row - y, y, height, x, taps_y, border, cval
                )
        for k in range(wp.where(pair, 2, 1)):
            fill_margins(lines.values, 2 * slab + k, margin, columns, step, border, cval)
            for lane in range((stored + WIDE - 1) // WIDE):
                x = wp.min(lane * WIDE, stored - WIDE)
                dst[plane, y + k, x] = sum_along(lines.wide, 2 * slab + k, x, step, taps_x)
        row += wp.where(pair, 2, 1)
