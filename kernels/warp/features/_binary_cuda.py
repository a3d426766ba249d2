"""FAST corners on CUDA, a thread a pixel, and their bits, a block a point: see the Taichi set."""

import warp as wp

from cvkern.kernels.codes import features as codes
from cvkern.kernels.warp import _native

from ._binary_cpu import DESCRIBE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = 128  # threads of a block
BITS = wp.constant(codes.WORD)
SHARES = wp.constant(codes.SHARES)
HALF = wp.constant(codes.SHARES // 2)
circle_t = wp.types.matrix(shape=(16, 2), dtype=wp.int32)
around_t = wp.types.vector(16, wp.int32)
PLACES = wp.constant(circle_t(codes.CIRCLE))


@wp.kernel
def round_values(
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[wp.uint8],
):
    y, x = wp.tid()
    dst[y, x] = wp.uint8(int(wp.clamp(src[y, x], 0.0, 255.0) + 0.5))


@wp.kernel
def shrink_down(
    src: wp.array2d[wp.uint8],
    tops: wp.array[int],  # (H',)
    down: wp.array2d[wp.uint8],  # (H', T)
    # outputs
    lines: wp.array2d[wp.uint8],  # (H', W)
):
    y, x = wp.tid()
    total = HALF
    for t in range(down.shape[1]):
        w = int(down[y, t])
        if w != 0:
            total += w * int(src[tops[y] + t, x])
    lines[y, x] = wp.uint8(total // SHARES)


@wp.kernel
def shrink_along(
    lines: wp.array2d[wp.uint8],
    starts: wp.array[int],  # (W',)
    along: wp.array2d[wp.uint8],  # (W', T)
    # outputs
    dst: wp.array2d[wp.uint8],  # (H', W')
):
    y, x = wp.tid()
    total = HALF
    for t in range(along.shape[1]):
        w = int(along[x, t])
        if w != 0:
            total += w * int(lines[y, starts[x] + t])
    dst[y, x] = wp.uint8(total // SHARES)


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


@wp.kernel
def weigh(
    images: wp.array2d[wp.int64],  # (O, 4)
    cells: wp.array2d[int],  # (N, 4)
    # outputs
    responses: wp.array[wp.int64],
):
    n = wp.tid()
    image = cells[n, 0]
    shape = (int(images[image, 2]), int(images[image, 3]))
    src = wp.array(ptr=wp.uint64(images[image, 0]), shape=shape, dtype=wp.uint8)
    row = cells[n, 2]
    column = cells[n, 3]
    yy = int(0)
    xx = int(0)
    xy = int(0)
    for y in range(row - 3, row + 4):
        for x in range(column - 3, column + 4):
            nw = int(src[y - 1, x - 1])
            ne = int(src[y - 1, x + 1])
            sw = int(src[y + 1, x - 1])
            se = int(src[y + 1, x + 1])
            gy = sw - nw + se - ne + 2 * (int(src[y + 1, x]) - int(src[y - 1, x]))
            gx = ne - nw + se - sw + 2 * (int(src[y, x + 1]) - int(src[y, x - 1]))
            yy += gy * gy
            xx += gx * gx
            xy += gx * gy
    det = wp.int64(yy) * wp.int64(xx) - wp.int64(xy) * wp.int64(xy)
    trace = wp.int64(yy) + wp.int64(xx)
    responses[n] = wp.int64(25) * det - trace * trace


@_native.kernel("_binary_cuda.cu", **DESCRIBE)
def describe(
    images: wp.array2d[wp.int64],
    cells: wp.array2d[int],
    pattern: wp.array3d[wp.int16],  # (TURNS, PAIRS, 2)
    upright: int,
    # outputs
    angles: wp.array[float],
    descriptors: wp.array2d[wp.uint8],
): ...
