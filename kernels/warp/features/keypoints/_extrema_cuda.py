"""Extrema of a scale space on CUDA, where a thread takes a pixel. The Taichi set has the rule."""

import warp as wp

from cvkern.kernels.codes.features import GRAY, MOST_GRAY, WORD

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BITS = wp.constant(WORD)
BRIGHTEST = wp.constant(MOST_GRAY)
RED, GREEN, BLUE = (wp.constant(w) for w in GRAY)


@wp.kernel
def gray(
    src: wp.array3d[float],  # (H, W, C)
    scale: float,
    # outputs
    dst: wp.array2d[float],  # (H, W)
):
    y, x = wp.tid()
    v = src[y, x, 0]
    if src.shape[2] > 1:
        v = RED * v + GREEN * src[y, x, 1] + BLUE * src[y, x, 2]
    v = v * scale
    if not (wp.abs(v) <= BRIGHTEST):  # NaN as well
        v = 0.0
    dst[y, x] = v


@wp.kernel
def halve(
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[float],
):
    y, x = wp.tid()
    dst[y, x] = src[2 * y, 2 * x]


@wp.kernel
def double(
    src: wp.array2d[float],  # (H, W)
    # outputs
    dst: wp.array2d[float],  # (2 H, 2 W)
):
    v, u = wp.tid()
    y = v // 2
    x = u // 2
    below = wp.where(v % 2 == 1, wp.min(y + 1, src.shape[0] - 1), y)
    right = wp.where(u % 2 == 1, wp.min(x + 1, src.shape[1] - 1), x)
    left = 0.5 * (src[y, x] + src[below, x])
    dst[v, u] = 0.5 * (left + 0.5 * (src[y, right] + src[below, right]))


@wp.func
def exceeded(levels: wp.array3d[float], l: int, y: int, x: int, v: float, sign: float) -> bool:
    """Tell whether one of the nine differences about a pixel exceeds `v`; `sign` turns minima."""
    for i in range(y - 1, y + 2):
        for j in range(x - 1, x + 2):
            if sign * (levels[l + 1, i, j] - levels[l, i, j]) > v:
                return True
    return False


@wp.kernel
def mark(
    levels: wp.array3d[float],  # (L, H, W)
    threshold: float,
    margin: int,
    # outputs
    words: wp.array3d[int],  # (L - 3, H, ceil(W / 32)), cleared
):
    y, x = wp.tid()
    height = levels.shape[1]
    width = levels.shape[2]
    if y < margin or y >= height - margin or x < margin or x >= width - margin:
        return
    low = levels[1, y, x]
    for l in range(1, levels.shape[0] - 2):
        high = levels[l + 1, y, x]
        v = high - low
        low = high
        if wp.abs(v) > threshold:
            sign = wp.where(v < 0.0, -1.0, 1.0)
            v = sign * v
            if not exceeded(levels, l, y, x, v, sign):
                if not exceeded(levels, l - 1, y, x, v, sign):
                    if not exceeded(levels, l + 1, y, x, v, sign):
                        # Sets a bit that no other thread sets: the order cannot show.
                        wp.atomic_or(words, l - 1, y, x // BITS, 1 << (x % BITS))
