"""FAST corners on CUDA, where a thread takes a pixel. The Taichi set has the rule."""

import warp as wp

from cvkern.kernels.codes.features import CIRCLE, WORD

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BITS = wp.constant(WORD)
circle_t = wp.types.matrix(shape=(16, 2), dtype=wp.int32)
around_t = wp.types.vector(16, wp.int32)
PLACES = wp.constant(circle_t(CIRCLE))


@wp.kernel
def round_values(
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[wp.uint8],
):
    y, x = wp.tid()
    dst[y, x] = wp.uint8(int(wp.clamp(src[y, x], 0.0, 255.0) + 0.5))


@wp.kernel
def widen_values(
    src: wp.array2d[wp.uint8],
    # outputs
    dst: wp.array2d[float],
):
    y, x = wp.tid()
    dst[y, x] = float(src[y, x])


@wp.func
def longest(d: around_t) -> int:
    """Return the largest of the least of 9 neighbours round the circle."""
    best = int(0)
    for k in range(16):
        least = d[k]
        for n in range(1, 9):
            least = wp.min(least, d[(k + n) % 16])
        best = wp.max(best, least)
    return best


@wp.kernel
def score(
    src: wp.array2d[wp.uint8],
    threshold: int,
    margin: int,
    # outputs
    scores: wp.array2d[wp.uint8],
):
    y, x = wp.tid()
    best = int(0)
    if y >= margin and y < src.shape[0] - margin and x >= margin and x < src.shape[1] - margin:
        v = int(src[y, x])
        d = around_t()
        for k in range(16):
            d[k] = int(src[y + PLACES[k, 0], x + PLACES[k, 1]]) - v
        best = wp.max(longest(d), longest(-d))
    scores[y, x] = wp.uint8(wp.where(best > threshold, best, 0))


@wp.kernel
def mark(
    scores: wp.array2d[wp.uint8],
    # outputs
    words: wp.array3d[int],  # (1, H, K), cleared
):
    y, x = wp.tid()
    v = scores[y, x]
    if v == wp.uint8(0) or y == 0 or x == 0:
        return
    if y == scores.shape[0] - 1 or x == scores.shape[1] - 1:
        return
    for i in range(-1, 2):
        for j in range(-1, 2):
            near = scores[y + i, x + j]
            earlier = i < 0 or (i == 0 and j < 0)
            if near > v or (earlier and near == v):
                return
    # Sets a bit that no other thread sets: the order cannot show.
    wp.atomic_or(words, 0, y, x // BITS, 1 << (x % BITS))
