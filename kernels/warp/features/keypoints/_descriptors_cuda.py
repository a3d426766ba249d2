"""Orientations and descriptors on CUDA: a thread takes a row of a point's window.

The Taichi set has the rules; sums are integers, so that atomics give the same result in any order.
"""

import warp as wp

from cvkern.kernels.codes import features as codes
from cvkern.kernels.warp._angles import atan2

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BINS = wp.constant(codes.BINS)
PEAKS = wp.constant(codes.PEAKS)
LONGEST = wp.constant(codes.LONGEST)
BINS_PER_RADIAN = wp.constant(codes.BINS_PER_RADIAN)
CELLS = wp.constant(codes.CELLS)
DIRECTIONS = wp.constant(codes.DIRECTIONS)
PER_RADIAN = wp.constant(codes.DIRECTIONS_PER_RADIAN)
NUMBERS = wp.constant(codes.CELLS * codes.CELLS * codes.DIRECTIONS)
SHARE = wp.constant(wp.float64(codes.LARGEST_SHARE))
ONE = wp.constant(wp.float64(codes.DESCRIPTOR_ONE))
F7, F6, F5, F4, F3, F2 = (wp.constant(f) for f in codes.decay_factors())


@wp.func
def decay(x: float) -> float:
    """exp(-x) for 0 <= x <= 8: a series for x / 16, squared four times."""
    y = x * 0.0625
    p = float(1.0)
    p = 1.0 - y * F7 * p
    p = 1.0 - y * F6 * p
    p = 1.0 - y * F5 * p
    p = 1.0 - y * F4 * p
    p = 1.0 - y * F3 * p
    p = 1.0 - y * F2 * p
    p = 1.0 - y * p
    p = p * p
    p = p * p
    p = p * p
    return p * p


@wp.func
def length_of(dy: float, dx: float) -> float:
    """Return the length of a gradient, cut off."""
    return wp.min(wp.sqrt(dx * dx + dy * dy), LONGEST)


@wp.kernel
def vote_directions(
    levels: wp.array3d[float],
    cells: wp.array2d[int],  # (N, 4): level, row, column, radius
    spreads: wp.array[float],
    one: float,
    # outputs
    sums: wp.array2d[int],  # (N, BINS), cleared
):
    k, line = wp.tid()
    radius = cells[k, 3]
    i = line - radius
    y = cells[k, 1] + i
    if i > radius or y < 1 or y > levels.shape[1] - 2:
        return
    s = cells[k, 0]
    cx = cells[k, 2]
    down = decay(float(i * i) * spreads[k])
    for x in range(wp.max(cx - radius, 1), wp.min(cx + radius, levels.shape[2] - 2) + 1):
        dx = levels[s, y, x + 1] - levels[s, y, x - 1]
        dy = levels[s, y + 1, x] - levels[s, y - 1, x]
        along = decay(float((x - cx) * (x - cx)) * spreads[k])
        bin = atan2(dy, dx) * BINS_PER_RADIAN + 0.5
        bin = wp.where(bin < 0.0, bin + float(BINS), bin)
        b = int(bin)
        b = wp.where(b >= BINS, b - BINS, b)
        wp.atomic_add(sums, k, b, int(length_of(dy, dx) * (down * along) * one + 0.5))


@wp.func
def smooth(sums: wp.array2d[int], k: int, b: int) -> wp.int64:
    """Weigh five neighbouring bins by 1 4 6 4 1."""
    near = wp.int64(sums[k, (b + 1) % BINS]) + wp.int64(sums[k, (b + BINS - 1) % BINS])
    far = wp.int64(sums[k, (b + 2) % BINS]) + wp.int64(sums[k, (b + BINS - 2) % BINS])
    return far + wp.int64(4) * near + wp.int64(6) * wp.int64(sums[k, b])


@wp.kernel
def pick_directions(
    sums: wp.array2d[int],
    # outputs
    angles: wp.array2d[float],  # (N, PEAKS)
    counts: wp.array[int],
):
    k = wp.tid()
    most = wp.int64(0)
    for b in range(BINS):
        most = wp.max(most, smooth(sums, k, b))
    count = int(0)
    above = wp.int64(0)  # the last one taken, and its bin
    taken = int(-1)
    for _ in range(PEAKS):
        best = int(-1)
        high = wp.int64(-1)
        for b in range(BINS):
            v = smooth(sums, k, b)
            left = smooth(sums, k, (b + BINS - 1) % BINS)
            right = smooth(sums, k, (b + 1) % BINS)
            peak = v > left and v > right and wp.int64(5) * v >= wp.int64(4) * most
            later = taken < 0 or v < above or (v == above and b > taken)
            if peak and later and v > high:
                best = b
                high = v
        if best >= 0:
            left = smooth(sums, k, (best + BINS - 1) % BINS)
            right = smooth(sums, k, (best + 1) % BINS)
            off = wp.float64(left - right) / wp.float64(left - wp.int64(2) * high + right)
            angles[k, count] = float(wp.float64(best) + wp.float64(0.5) * off)
            count += 1
            taken = best
            above = high
    counts[k] = count


@wp.kernel
def vote_cells(
    levels: wp.array3d[float],
    cells: wp.array2d[int],
    turns: wp.array2d[float],  # (N, 4): cosine and sine over a cell's side, angle, spread
    one: float,
    # outputs
    sums: wp.array2d[int],  # (N, ROOM), cleared
):
    k, line = wp.tid()
    radius = cells[k, 3]
    down_by = line - radius
    y = cells[k, 1] + down_by
    if down_by > radius or y < 1 or y > levels.shape[1] - 2:
        return
    s = cells[k, 0]
    cx = cells[k, 2]
    cosine = turns[k, 0]
    sine = turns[k, 1]
    i = float(down_by)
    row0 = i * cosine
    column0 = i * sine
    down = decay(float(down_by * down_by) * turns[k, 3])
    for x in range(wp.max(cx - radius, 1), wp.min(cx + radius, levels.shape[2] - 2) + 1):
        j = float(x - cx)
        r = (row0 - j * sine) + 1.5
        c = (column0 + j * cosine) + 1.5
        if r > -1.0 and r < float(CELLS) and c > -1.0 and c < float(CELLS):
            dx = levels[s, y, x + 1] - levels[s, y, x - 1]
            dy = levels[s, y + 1, x] - levels[s, y - 1, x]
            along = decay(float((x - cx) * (x - cx)) * turns[k, 3])
            v = length_of(dy, dx) * (down * along) * one
            bin = (atan2(dy, dx) - turns[k, 2]) * PER_RADIAN
            bin = wp.where(bin < 0.0, bin + float(DIRECTIONS), bin)
            bin = wp.where(bin >= float(DIRECTIONS), bin - float(DIRECTIONS), bin)
            r0 = int(r + 1.0)
            c0 = int(c + 1.0)
            o0 = int(bin)
            fr = (r + 1.0) - float(r0)
            fc = (c + 1.0) - float(c0)
            fd = bin - float(o0)
            v1 = v * fr
            v0 = v - v1
            v11 = v1 * fc
            v01 = v0 * fc
            at = (r0 * (CELLS + 2) + c0) * (DIRECTIONS + 1) + o0
            under = at + (CELLS + 2) * (DIRECTIONS + 1)
            add_both(sums, k, at, v0 - v01, fd)
            add_both(sums, k, at + DIRECTIONS + 1, v01, fd)
            add_both(sums, k, under, v1 - v11, fd)
            add_both(sums, k, under + DIRECTIONS + 1, v11, fd)


@wp.func
def add_both(sums: wp.array2d[int], k: int, at: int, v: float, fd: float):
    """Share a contribution between two directions."""
    w = v * fd
    wp.atomic_add(sums, k, at, int((v - w) + 0.5))
    wp.atomic_add(sums, k, at + 1, int(w + 0.5))


@wp.func
def bin_of(sums: wp.array2d[int], k: int, n: int) -> wp.float64:
    """Return number `n` of a descriptor before it is normalised."""
    o = n % DIRECTIONS
    c = n // DIRECTIONS % CELLS
    r = n // DIRECTIONS // CELLS
    at = ((r + 1) * (CELLS + 2) + c + 1) * (DIRECTIONS + 1)
    v = sums[k, at + o]
    if o == 0:
        v += sums[k, at + DIRECTIONS]
    return wp.float64(v)


@wp.kernel
def normalise(
    sums: wp.array2d[int],
    root: int,
    # outputs
    descriptors: wp.array2d[wp.uint8],  # (N, 128)
):
    k = wp.tid()
    squares = wp.float64(0.0)
    for n in range(NUMBERS):
        v = bin_of(sums, k, n)
        squares += v * v
    most = SHARE * wp.sqrt(squares)
    total = wp.float64(0.0)
    for n in range(NUMBERS):
        v = wp.min(bin_of(sums, k, n), most)
        total += wp.where(root == 1, v, v * v)
    size = wp.where(root == 1, total, wp.sqrt(total))
    for n in range(NUMBERS):
        share = wp.float64(0.0)
        if size > wp.float64(0.0):
            share = wp.min(bin_of(sums, k, n), most) / size
        if root == 1:
            share = wp.sqrt(share)
        share = ONE * share + wp.float64(0.5)
        descriptors[k, n] = wp.uint8(int(wp.min(share, wp.float64(255.0))))
