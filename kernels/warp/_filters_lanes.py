"""Linear filters on the CPU: one thread a slab of rows, a vector of pixels at a time."""

import warp as wp

from ._borders import border_index
from ._lanes import LANES, f32_lanes

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def correlate_separable(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],  # (P H, N)
    src_lanes: wp.array2d[f32_lanes],
    height: int,  # H
    columns: int,  # W step <= N
    taps_y: wp.array[float],  # (2 ry + 1,)
    taps_x: wp.array[float],  # (2 rx + 1,)
    step: int,
    border: int,
    cval: float,
    # scratch
    line: wp.array2d[float],  # (slabs, rx step + N + rx step): one row between the passes
    line_lanes: wp.array2d[f32_lanes],
    # outputs
    dst_lanes: wp.array2d[f32_lanes],  # (P H, N)
):
    stored = src.shape[1]
    ny = taps_y.shape[0]
    nx = taps_x.shape[0]
    ry = ny // 2
    margin = nx // 2 * step
    for row in range(first, last):
        y = row % height
        plane = row - y
        for lane in range((stored + LANES - 1) // LANES):
            x = wp.min(lane * LANES, stored - LANES)
            acc = f32_lanes(0.0)
            if y >= ry and y + ry < height:
                for t in range(ny):
                    acc += taps_y[t] * src_lanes[row + t - ry, x]
            else:
                for t in range(ny):
                    v = border_index(y + t - ry, height, border)
                    if v < 0:
                        acc += f32_lanes(taps_y[t] * cval)
                    else:
                        acc += taps_y[t] * src_lanes[plane + v, x]
            line_lanes[slab, margin + x] = acc
        for i in range(margin):
            line[slab, i] = outside(line, slab, margin, i - margin, columns, step, border, cval)
            line[slab, margin + columns + i] = outside(
                line, slab, margin, columns + i, columns, step, border, cval
            )
        for lane in range((stored + LANES - 1) // LANES):
            x = wp.min(lane * LANES, stored - LANES)
            acc = f32_lanes(0.0)
            for t in range(nx):
                acc += taps_x[t] * line_lanes[slab, x + t * step]
            dst_lanes[row, x] = acc


@wp.func
def outside(
    line: wp.array2d[float],
    slab: int,
    margin: int,
    i: int,
    columns: int,
    step: int,
    border: int,
    cval: float,
) -> float:
    """Value that `border` gives element `i` of a row whose element 0 stands at `margin`."""
    pixel = wp.floordiv(i, step)
    inside = border_index(pixel, columns // step, border)
    if inside < 0:
        return cval
    return line[slab, margin + inside * step + i - pixel * step]
