"""Extrema between the pixels and levels of a scale space, in Warp.

The Taichi set has the equations. One thread takes a point; on the CPU, a slab of points.
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.codes.features import MOVES
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp.features._levels import table

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MOST = wp.constant(MOVES)
HALF = wp.constant(0.5)


def refine(
    octaves: Sequence[wp.array],
    contrast: float,
    edge: float,
    margin: int,
    offsets: wp.array,
    cells: wp.array,
) -> None:
    """Fit a paraboloid to each extremum, and move it to where that has its own; a thread each.

    `cells` holds octave, level, row and column before and afterwards; the octave of an extremum
    that is not kept becomes -1.
    """
    count = cells.shape[0]
    inputs = [table(octaves), contrast, edge, margin]
    launch_each(_fit, count, 100 * count, inputs, [offsets, cells])


@wp.func
def difference(levels: wp.array3d[float], s: int, y: int, x: int) -> wp.float64:
    """Return the difference of two neighbouring levels."""
    return wp.float64(levels[s + 1, y, x] - levels[s, y, x])


@wp.kernel
def _fit(
    stride: int,
    first: int,
    last: int,
    octaves: wp.array2d[wp.int64],  # (O, 4)
    contrast: float,  # least height
    edge: float,  # largest tr^2 / det
    margin: int,
    # outputs
    offsets: wp.array2d[float],  # (N, 4): row, column, level, height
    # in place
    cells: wp.array2d[int],  # (N, 4): octave, level, row, column
):
    half = wp.float64(0.5)
    for n in range(first + wp.tid(), last, stride):
        o = cells[n, 0]
        s = cells[n, 1]
        y = cells[n, 2]
        x = cells[n, 3]
        height = int(octaves[o, 2])
        width = int(octaves[o, 3])
        levels = wp.array(
            ptr=wp.uint64(octaves[o, 0]),
            shape=(int(octaves[o, 1]) + 3, height, width),
            dtype=wp.float32,
        )
        kept = int(0)
        oy = wp.float64(0.0)
        ox = wp.float64(0.0)
        os = wp.float64(0.0)
        top = wp.float64(0.0)
        for _ in range(MOST):
            c = difference(levels, s, y, x)
            u = difference(levels, s, y - 1, x)
            d = difference(levels, s, y + 1, x)
            l = difference(levels, s, y, x - 1)
            r = difference(levels, s, y, x + 1)
            b = difference(levels, s - 1, y, x)
            a = difference(levels, s + 1, y, x)
            gy = half * (d - u)
            gx = half * (r - l)
            gs = half * (a - b)
            yy = d + u - c - c
            xx = r + l - c - c
            ss = a + b - c - c
            quarter = half * half
            xy = quarter * (
                difference(levels, s, y + 1, x + 1)
                - difference(levels, s, y + 1, x - 1)
                - difference(levels, s, y - 1, x + 1)
                + difference(levels, s, y - 1, x - 1)
            )
            xs = quarter * (
                difference(levels, s + 1, y, x + 1)
                - difference(levels, s + 1, y, x - 1)
                - difference(levels, s - 1, y, x + 1)
                + difference(levels, s - 1, y, x - 1)
            )
            ys = quarter * (
                difference(levels, s + 1, y + 1, x)
                - difference(levels, s + 1, y - 1, x)
                - difference(levels, s - 1, y + 1, x)
                + difference(levels, s - 1, y - 1, x)
            )
            # The inverse by cofactors.
            m00 = yy * ss - ys * ys
            m01 = xs * ys - xy * ss
            m02 = xy * ys - xs * yy
            det = xx * m00 + xy * m01 + xs * m02
            if det == wp.float64(0.0):
                break
            m11 = xx * ss - xs * xs
            m12 = xy * xs - xx * ys
            m22 = xx * yy - xy * xy
            ox = -((m00 * gx + m01 * gy + m02 * gs) / det)
            oy = -((m01 * gx + m11 * gy + m12 * gs) / det)
            os = -((m02 * gx + m12 * gy + m22 * gs) / det)
            if wp.abs(ox) < half and wp.abs(oy) < half and wp.abs(os) < half:
                top = c + half * (gx * ox + gy * oy + gs * os)
                trace = xx + yy
                # This is tr^2 / det < edge, for a positive det.
                if wp.abs(top) >= wp.float64(contrast) and m22 > wp.float64(0.0):
                    if trace * trace < wp.float64(edge) * m22:
                        kept = int(1)
                break
            # Beyond two pixels the fit means nothing.
            if not (wp.abs(ox) < wp.float64(3.0) and wp.abs(oy) < wp.float64(3.0)):
                break
            if not (wp.abs(os) < wp.float64(3.0)):
                break
            x += int(wp.floor(ox + half))
            y += int(wp.floor(oy + half))
            s += int(wp.floor(os + half))
            if s < 1 or s > levels.shape[0] - 3:
                break
            if y < margin or y >= height - margin or x < margin or x >= width - margin:
                break
        offsets[n, 0] = float(oy)
        offsets[n, 1] = float(ox)
        offsets[n, 2] = float(os)
        offsets[n, 3] = float(wp.abs(top))
        cells[n, 0] = wp.where(kept == 1, o, -1)
        cells[n, 1] = s
        cells[n, 2] = y
        cells[n, 3] = x
