"""Linear filters on the CPU: one thread a slab of rows, a vector of pixels at a time."""

import warp as wp

from ._angles import atan2
from ._borders import border_index
from ._lanes import LANES, f32_lanes, i32_lanes

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


@wp.kernel
def polar(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[f32_lanes],  # (1, N)
    dx: wp.array2d[f32_lanes],
    # outputs
    magnitude: wp.array2d[f32_lanes],
    orientation: wp.array2d[f32_lanes],
):
    for lane in range(first, last):
        i = wp.min(lane * LANES, dy.shape[1] - 1)
        y = dy[0, i]
        x = dx[0, i]
        length = f32_lanes(0.0)
        angle = f32_lanes(0.0)
        for k in range(LANES):
            length[k] = wp.sqrt(x[k] * x[k] + y[k] * y[k])
            angle[k] = atan2(y[k], x[k])
        magnitude[0, i] = length
        orientation[0, i] = angle


@wp.kernel
def median(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[int],  # (P H, N)
    height: int,
    columns: int,
    radius: int,
    step: int,
    low: int,
    bits: int,
    border: int,
    cval: int,
    # scratch
    window: wp.array3d[int],  # (slabs, 2 radius + 1, radius step + N + radius step)
    window_lanes: wp.array3d[i32_lanes],
    # outputs
    dst_lanes: wp.array2d[i32_lanes],  # (P H, N)
):
    # The value of rank r is the largest v with at most r window values below v: bit by bit.
    size = 2 * radius + 1
    margin = radius * step
    rank = size * size // 2
    for row in range(first, last):
        y = row % height
        for t in range(size):
            v = border_index(y + t - radius, height, border)
            for i in range(window.shape[2]):
                pixel = wp.floordiv(i - margin, step)
                inside = border_index(pixel, columns // step, border)
                if i - margin >= columns + margin or v < 0 or inside < 0:
                    window[slab, t, i] = cval
                else:
                    c = i - margin - pixel * step
                    window[slab, t, i] = src[row - y + v, inside * step + c]
        for lane in range((src.shape[1] + LANES - 1) // LANES):
            x = wp.min(lane * LANES, src.shape[1] - LANES)
            found = i32_lanes(low)
            for b in range(bits):
                middle = found + i32_lanes(1 << (bits - 1 - b))
                below = i32_lanes(0)
                for t in range(size):
                    for u in range(size):
                        value = window_lanes[slab, t, x + u * step]
                        for k in range(LANES):
                            below[k] += wp.where(value[k] < middle[k], 1, 0)
                for k in range(LANES):
                    if below[k] <= rank:
                        found[k] = middle[k]
            dst_lanes[row, x] = found
