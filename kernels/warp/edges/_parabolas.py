"""Sub-pixel places of edges: the maxima of parabolas through logarithms of gradient lengths."""

import warp as wp

from cvkern.kernels.codes.edges import LEAST_MANTISSA, LEAST_RATIO, LN2, LOG, MANTISSA_BITS
from cvkern.kernels.warp._angles import atan2

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

L0, L1, L2, L3, L4 = (wp.constant(c) for c in LOG)
SMALLEST = wp.constant(LEAST_RATIO)
HALF_ROOT = wp.constant(LEAST_MANTISSA)
SHIFT = wp.constant(MANTISSA_BITS)
LOG_2 = wp.constant(LN2)


@wp.func
def _log_of_ratio(a: float, b: float) -> float:
    """Logarithm of a / b: sums, products and quotients alone, so equal bits on every device."""
    ratio = wp.max(a / b, SMALLEST)
    bits = wp.cast(ratio, wp.int32)
    exponent = (bits - HALF_ROOT) >> SHIFT
    m = wp.cast(bits - (exponent << SHIFT), wp.float32)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    series = (((L4 * z + L3) * z + L2) * z + L1) * z + L0
    return 2.0 * s * series + float(exponent) * LOG_2


@wp.func
def _squared(dy: wp.array2d[float], dx: wp.array2d[float], y: int, x: int) -> float:
    """Return the squared gradient length at (y, x), 0 outside the image."""
    if y < 0 or x < 0 or y >= dy.shape[0] or x >= dy.shape[1]:
        return 0.0
    return dx[y, x] * dx[y, x] + dy[y, x] * dy[y, x]


@wp.func
def three_lengths(dy: wp.array2d[float], dx: wp.array2d[float], y: int, x: int) -> wp.vec3:
    """Return squared lengths before, at and after (y, x), along the larger derivative."""
    down = wp.where(wp.abs(dy[y, x]) > wp.abs(dx[y, x]), 1, 0)
    across = 1 - down
    return wp.vec3(
        _squared(dy, dx, y - down, x - across),
        _squared(dy, dx, y, x),
        _squared(dy, dx, y + down, x + across),
    )


@wp.func
def is_peak(m: wp.vec3) -> bool:
    """Tell whether a parabola through the logarithms of `m` has its maximum near the middle."""
    return m[1] > m[0] and m[1] >= m[2] and m[0] > 0.0 and m[2] > 0.0 and m[1] < wp.inf


@wp.func
def locate(
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    y: int,
    x: int,
    m: wp.vec3,
    i: int,
    points: wp.array2d[float],
    orientation: wp.array[float],
    strength: wp.array[float],
):
    """List the edge at the maximum of the parabola through the logarithms of `m`, at place i."""
    p = _log_of_ratio(m[0], m[1])
    q = _log_of_ratio(m[2], m[1])
    offset = 0.5 * (p - q) / (p + q)
    down = wp.where(wp.abs(dy[y, x]) > wp.abs(dx[y, x]), 1.0, 0.0)
    points[i, 0] = float(y) + down * offset
    points[i, 1] = float(x) + (1.0 - down) * offset
    orientation[i] = atan2(dy[y, x], dx[y, x])
    strength[i] = wp.sqrt(m[1])
