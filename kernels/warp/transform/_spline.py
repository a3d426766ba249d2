"""Coefficients of the cubic B-spline that passes through the pixels, in Warp.

With the pole ``z = sqrt(3) - 2``, a recursion there, ``c+_k = 6 s_k + z c+_(k-1)``, and back,
``c_k = z (c_(k+1) - c+_k)``, along each line gives the coefficients of the pixels s [M. Unser,
A. Aldroubi and M. Eden, "B-spline signal processing", IEEE Trans. Signal Processing 41, 1993].
Lines are continued as scipy.ndimage does. One thread takes a line.
"""

import warp as wp

from cvkern.kernels.codes.transform import SPLINE_GAIN, SPLINE_POLE, SPLINE_REACH

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

POLE = wp.constant(wp.float64(SPLINE_POLE))
GAIN = wp.constant(SPLINE_GAIN)
REACH = wp.constant(SPLINE_REACH)


@wp.func
def first_of(lines: wp.array3d[float], o: int, i: int, reflect: int) -> wp.float64:
    """Return the causal coefficient of the first pixel, of a line mirrored without end."""
    n = lines.shape[1]
    z = POLE
    gain = wp.float64(GAIN)
    far = wp.float64(1.0)  # z^(n - 1), or z^n
    if n <= REACH:
        for _ in range(n - 1 + reflect):
            far = far * z
    else:
        far = wp.float64(0.0)
    start = gain * wp.float64(lines[o, 0, i])
    total = start + far * (gain * wp.float64(lines[o, n - 1, i]))
    power = z
    for k in range(1, wp.min(n - 1 + reflect, REACH)):
        ahead = gain * wp.float64(lines[o, k, i])
        back = gain * wp.float64(lines[o, n - 1 - k, i])
        total = total + power * (ahead + far * back)
        power = power * z
    if reflect == 1:
        return total * (z / (wp.float64(1.0) - far * far)) + start
    return total / (wp.float64(1.0) - far * far)


@wp.kernel
def recurse(
    stride: int,
    first: int,
    last: int,
    reflect: int,  # 1: the line is mirrored about the edges of its ends, 0: about their centres
    # in place
    lines: wp.array3d[float],  # (outer, n, inner)
):
    n = lines.shape[1]
    inner = lines.shape[2]
    z = POLE
    for item in range(first + wp.tid(), last, stride):
        o = item // inner
        i = item - o * inner
        value = first_of(lines, o, i, reflect)
        lines[o, 0, i] = float(value)
        before = value
        for k in range(1, n):
            before = value
            value = wp.float64(GAIN) * wp.float64(lines[o, k, i]) + z * value
            lines[o, k, i] = float(value)
        if reflect == 1:
            value = value * (z / (z - wp.float64(1.0)))
        else:
            value = (z * before + value) * (z / (z * z - wp.float64(1.0)))
        lines[o, n - 1, i] = float(value)
        for k in range(1, n):
            value = z * (value - wp.float64(lines[o, n - 1 - k, i]))
            lines[o, n - 1 - k, i] = float(value)


@wp.kernel
def pad(
    stride: int,
    first: int,
    last: int,
    src: wp.array4d[float],  # (P, H, W, C)
    margin: int,
    # outputs
    dst: wp.array4d[float],  # (P, H + 2 margin, W + 2 margin, C)
):
    # A thread a pixel.
    height = dst.shape[1]
    width = dst.shape[2]
    for item in range(first + wp.tid(), last, stride):
        row = item // width
        x = item - row * width
        p = row // height
        i = wp.clamp(row - p * height - margin, 0, src.shape[1] - 1)
        j = wp.clamp(x - margin, 0, src.shape[2] - 1)
        for c in range(src.shape[3]):
            dst[p, row - p * height, x, c] = src[p, i, j, c]


@wp.func
def edge(i: int, n: int) -> float:
    """Return the weight of a pixel of a mirrored line: a half at its ends, 1 between."""
    if n > 1 and (i == 0 or i == n - 1):
        return 0.5
    return 1.0


@wp.kernel
def narrow(
    stride: int,
    first: int,
    last: int,
    sums: wp.array4d[wp.float64],  # (P, H', W', C)
    mirrored: int,
    # outputs
    dst: wp.array4d[float],
):
    # A thread a pixel. The filter F of a mirrored line has the transpose D F D^-1, where D halves
    # the ends: this divides by D, `fold` multiplies.
    height = sums.shape[1]
    width = sums.shape[2]
    for item in range(first + wp.tid(), last, stride):
        row = item // width
        x = item - row * width
        p = row // height
        y = row - p * height
        ends = float(1.0)
        if mirrored == 1:
            ends = edge(y, height) * edge(x, width)
        for c in range(sums.shape[3]):
            dst[p, y, x, c] = float(sums[p, y, x, c]) / ends


@wp.kernel
def fold(
    stride: int,
    first: int,
    last: int,
    padded: wp.array4d[float],  # (P, H + 2 margin, W + 2 margin, C)
    margin: int,
    mirrored: int,
    # outputs
    dst: wp.array4d[float],  # (P, H, W, C)
):
    # A thread a pixel: the gradients of its copies in the margin are its own.
    height = dst.shape[1]
    width = dst.shape[2]
    for item in range(first + wp.tid(), last, stride):
        row = item // width
        x = item - row * width
        p = row // height
        y = row - p * height
        top = wp.where(y == 0, 0, y + margin)
        bottom = wp.where(y == height - 1, height + 2 * margin, y + margin + 1)
        left = wp.where(x == 0, 0, x + margin)
        right = wp.where(x == width - 1, width + 2 * margin, x + margin + 1)
        ends = float(1.0)
        if mirrored == 1:
            ends = edge(y, height) * edge(x, width)
        for c in range(dst.shape[3]):
            total = float(0.0)
            for i in range(top, bottom):
                for j in range(left, right):
                    total += padded[p, i, j, c]
            dst[p, y, x, c] = total * ends
