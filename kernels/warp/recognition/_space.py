"""Places and scales of votes, and the cells that they fall into."""

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Occurrences, Patches, Space

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BITS = wp.constant(wp.int64(codes.FACTOR_BITS))
ONE = wp.constant(wp.int64(1 << codes.FACTOR_BITS))
LARGE = wp.constant(wp.int64(1 << 30))
HALF = wp.constant(wp.int64(1 << (codes.FACTOR_BITS - 1)))


@wp.struct
class Cells:
    """Votes by their cells."""

    votes: wp.array2d[int]  # (V, 4)
    starts: wp.array[int]
    bins: wp.array2d[int]  # (S, 5)
    factors: wp.array[int]
    slack: int
    lowest: int


def cells_of(votes: wp.array, starts: wp.array, space: Space) -> Cells:
    """Return votes by their cells, for kernels."""
    cells = Cells()
    cells.votes, cells.starts = votes, starts
    cells.bins, cells.slack, cells.factors, cells.lowest = space
    return cells


@wp.struct
class Ballot:
    """Patches with their words, and the cells that these vote for."""

    places: wp.array2d[int]  # (N, 3)
    rows: wp.array2d[int]  # (R, 3)
    levels: wp.array2d[int]  # (L, 3)
    matches: wp.array2d[int]  # (N, M)
    begins: wp.array[int]  # (K + 1,)
    entries: wp.array2d[int]  # (O, 4)
    bins: wp.array2d[int]  # (S, 5)
    factors: wp.array[int]
    slack: int
    lowest: int
    listing: int
    """1: list the votes, which begin at `starts`. 0: count them."""
    starts: wp.array[int]


def ballot_of(
    patches: Patches, occurrences: Occurrences, space: Space, listing: int, starts: wp.array
) -> Ballot:
    """Return a ballot, for kernels."""
    ballot = Ballot()
    ballot.places, ballot.rows, ballot.levels, ballot.matches = patches
    ballot.begins, ballot.entries = occurrences
    ballot.bins, ballot.slack, ballot.factors, ballot.lowest = space
    ballot.listing, ballot.starts = listing, starts
    return ballot


@wp.struct
class Painter:
    """The kernel that weighs votes, and the boxes of patches and of the object at scale 0."""

    radius: int
    scales: int
    side: int
    """Side of a patch, in pixels."""
    half_height: int
    half_width: int


@wp.func
def scaled(size: int, factor: int) -> int:
    """Return a size times a factor of scale, halves rounded up."""
    return int((wp.int64(size) * wp.int64(factor) + HALF) >> BITS)


@wp.func
def below(size: int, factor: int) -> int:
    """Return size / factor in parts of 2^16, rounded down; |size| stays below 2^14 factors."""
    wide = wp.int64(size) * ONE + LARGE * wp.int64(factor)
    return int(wide // wp.int64(factor) - LARGE)


@wp.func
def factor_of(factors: wp.array[int], lowest: int, scale: int) -> int:
    return factors[wp.clamp(scale - lowest, 0, factors.shape[0] - 1)]


@wp.func
def first_from(places: wp.array2d[int], begin: int, end: int, column: int) -> int:
    """Return the first patch of a part of a row that is not before a column."""
    low = begin
    high = end
    while low < high:
        middle = (low + high) // 2
        if places[middle, 1] < column:
            low = middle + 1
        else:
            high = middle
    return low
