"""Order statistics of gradient lengths, by histograms of the digits of their bits.

The bit patterns of floats >= 0 have the order of their values. All counts are integers, so the
result is exact, and the same on every device.
"""

import warp as wp

from cvkern.kernels.codes.edges import Norm

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def bits_of(dy: float, dx: float, norm: int) -> int:
    """Return the bits of the value that thresholds are compared with; NaN counts as 0."""
    m = wp.where(norm == Norm.L1, wp.abs(dx) + wp.abs(dy), dx * dx + dy * dy)
    return wp.where(m > 0.0, wp.cast(m, wp.int32), 0)


@wp.kernel
def begin(
    ranks: wp.array[int],  # (2,)
    # outputs
    found: wp.array2d[int],  # (2 N, 2): the digits so far, and the rank among those that match
):
    i = wp.tid()
    found[i, 0] = 0
    found[i, 1] = ranks[i % 2]


@wp.kernel
def clear(
    # outputs
    counts: wp.array3d[int],  # (N, 2, BINS)
    most: wp.array[int],  # (N,)
):
    image, i = wp.tid()
    counts[image, 0, i] = 0
    counts[image, 1, i] = 0
    most[image] = 0


@wp.kernel
def choose(
    counts: wp.array3d[int],  # (slabs, 2, BINS)
    slabs: int,
    level: int,
    width: int,
    # outputs
    found: wp.array2d[int],  # (2, 2)
):
    # Both thresholds use the same counts of the first digit.
    i = wp.tid()
    row = wp.where(level == 0, 0, i)
    rank = found[i, 1]
    below = int(0)
    digit = int(0)
    passed = int(0)
    for k in range(1 << width):
        here = int(0)
        for slab in range(slabs):
            here += counts[slab, row, k]
        if below + here <= rank:
            digit = k + 1
            passed = below + here
        below += here
    found[i, 0] = (found[i, 0] << width) | digit
    found[i, 1] = rank - passed


@wp.kernel
def finish(
    found: wp.array2d[int],  # (2 N, 2)
    most: wp.array[int],  # (N slabs,)
    slabs: int,
    norm: int,
    strict: bool,
    share: float,
    # outputs
    limits: wp.array[float],  # (2 N,)
):
    # A pixel must exceed the limit. If it may equal the threshold, the limit is the float below.
    i = wp.tid()
    bits = found[i, 0]
    if not strict:
        bits = wp.max(bits - 1, 0)
    largest = int(0)
    for slab in range(slabs):
        largest = wp.max(largest, most[i // 2 * slabs + slab])
    least = float(0.0)
    if share > 0.0:  # 0 times infinity would be NaN
        least = wp.cast(largest, wp.float32) * share
        if norm == Norm.L2:
            least = least * share
    limits[i] = wp.max(wp.cast(bits, wp.float32), least)
