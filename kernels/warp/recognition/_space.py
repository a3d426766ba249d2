"""Places and scales of votes, and the cells that they fall into."""

import warp as wp

from cvkern.kernels.codes import recognition as codes

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BITS = wp.constant(wp.int64(codes.FACTOR_BITS))
HALF = wp.constant(wp.int64(1 << (codes.FACTOR_BITS - 1)))


@wp.func
def scaled(size: int, factor: int) -> int:
    """Return a size times a factor of scale, halves rounded up."""
    return int((wp.int64(size) * wp.int64(factor) + HALF) >> BITS)


@wp.func
def factor_of(factors: wp.array[int], lowest: int, scale: int) -> int:
    return factors[wp.clamp(scale - lowest, 0, factors.shape[0] - 1)]


@wp.func
def bin_of(bins: wp.array2d[int], scale: int, slack: int) -> int:
    """Return the bin whose scale is nearest, the first of several, or -1 beyond the slack."""
    found = int(-1)
    least = slack + 1
    for s in range(bins.shape[0]):
        apart = wp.abs(scale - bins[s, 3])
        if apart < least:
            least = apart
            found = s
    return found


@wp.func
def cell_of(bins: wp.array2d[int], s: int, y: int, x: int) -> int:
    """Return the cell of a place, or -1 outside of the image."""
    if s < 0 or y < 0 or x < 0:
        return -1
    row = y // bins[s, 4]
    column = x // bins[s, 4]
    if row >= bins[s, 1] or column >= bins[s, 2]:
        return -1
    return bins[s, 0] + row * bins[s, 2] + column


@wp.func
def active_words(matches: wp.array2d[int], i: int) -> int:
    """Return the number of words of a patch."""
    found = int(0)
    for m in range(matches.shape[1]):
        if matches[i, m] >= 0:
            found += 1
    return found
