"""Sub-pixel edge points, in Warp: one thread per row.

Across a blurred straight step the gradient is a Gaussian, along both axes. Its logarithm is a
parabola, and the edge is at the maximum of this parabola. With p and q the logarithms before and
after a pixel less the one at it, the maximum is at the offset ``(p - q) / (2 (p + q))``. There are
two passes: the points of each row are counted, and then listed at the row's place.
"""

import warp as wp

from cvkern.kernels.codes.edges import LEAST_MANTISSA, LEAST_RATIO, LN2, LOG, MANTISSA_BITS
from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp._launch import launch

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
def _three(dy: wp.array2d[float], dx: wp.array2d[float], y: int, x: int) -> wp.vec3:
    """Return squared lengths before, at and after (y, x), along the larger derivative."""
    down = wp.where(wp.abs(dy[y, x]) > wp.abs(dx[y, x]), 1, 0)
    across = 1 - down
    return wp.vec3(
        _squared(dy, dx, y - down, x - across),
        _squared(dy, dx, y, x),
        _squared(dy, dx, y + down, x + across),
    )


@wp.func
def _is_peak(m: wp.vec3) -> bool:
    """Tell whether a parabola through the logarithms of `m` has its maximum near the middle."""
    return m[1] > m[0] and m[1] >= m[2] and m[0] > 0.0 and m[2] > 0.0 and m[1] < wp.inf


@wp.kernel
def _count_edges(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    counts: wp.array[int],  # (H,)
):
    y = wp.tid()
    count = int(0)
    for x in range(mask.shape[1]):
        if mask[y, x] != wp.uint8(0):
            if _is_peak(_three(dy, dx, y, x)):
                count += 1
    counts[y] = count


@wp.kernel
def _gather_edges(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H,)
    # outputs
    points: wp.array2d[float],  # (N, 2)
    orientation: wp.array[float],  # (N,)
    strength: wp.array[float],  # (N,)
):
    y = wp.tid()
    i = starts[y]
    for x in range(mask.shape[1]):
        if mask[y, x] != wp.uint8(0):
            m = _three(dy, dx, y, x)
            if _is_peak(m):
                p = _log_of_ratio(m[0], m[1])
                q = _log_of_ratio(m[2], m[1])
                offset = 0.5 * (p - q) / (p + q)
                down = wp.where(wp.abs(dy[y, x]) > wp.abs(dx[y, x]), 1.0, 0.0)
                points[i, 0] = float(y) + down * offset
                points[i, 1] = float(x) + (1.0 - down) * offset
                orientation[i] = atan2(dy[y, x], dx[y, x])
                strength[i] = wp.sqrt(m[1])
                i += 1


def count_edges(dy: wp.array, dx: wp.array, mask: wp.array, counts: wp.array) -> None:
    """Count the sub-pixel edge points of each row."""
    launch(_count_edges, mask.shape[0], [dy, dx, mask], [counts])


def gather_edges(
    dy: wp.array,
    dx: wp.array,
    mask: wp.array,
    starts: wp.array,
    points: wp.array,
    orientation: wp.array,
    strength: wp.array,
) -> None:
    """Locate the edge points of each row, and list them at its place in `starts`."""
    launch(
        _gather_edges,
        mask.shape[0],
        [dy, dx, mask, starts],
        [points, orientation, strength],
    )
