"""The generalised Hough transform on the CPU: one thread per slab of slices, slice by slice.

An entry of the table is a vector v from a boundary point to the centre, and the direction of the
gradient there. For a rotation t and a scale s, each edge point p whose direction is that of the
entry, rotated by t, votes for the centre p + s R(t) v (Ballard, "Generalizing the Hough transform
to detect arbitrary shapes", Pattern Recognition 13(2), 1981). A slice is one rotation and one
scale; its accumulator stays in the cache.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, TILE
from cvkern.kernels.warp import _native

from ._ballot import SCALED_BITS, TURNED_BITS, Ballot

wp.set_module_options({"enable_backward": False})

LANES = 16  # points that are read at a time, even beyond the end of a window
LAST = wp.constant(DIRECTIONS - 1)
HALF = wp.constant(wp.int64(1 << (TURNED_BITS - 1)))
BITS = wp.constant(wp.int64(TURNED_BITS))


@_native.func_native("_votes_cpu.h", LANES=LANES, SCALED_BITS=SCALED_BITS)
def vote_slice(
    slab: int,
    scale: int,
    ballot: Ballot,
    windows: wp.array2d[int],
    cells: wp.array2d[wp.uint16],
):
    """Vote for one slice."""


@_native.func_native("_votes_cpu.h", TILE=TILE)
def find_peaks(
    slab: int,
    slice: int,
    ballot: Ballot,
    cells: wp.array2d[wp.uint16],
    keys: wp.array[int],
):
    """Find the 2 x 2 cells with most votes in each tile of a slice."""


@wp.func
def turn_entries(slab: int, rotation: int, ballot: Ballot, windows: wp.array2d[int]):
    """Write, for each entry, the range of points that vote with it, and its rotated vector."""
    code = ballot.turns[rotation, 0]
    cosine = wp.int64(ballot.turns[rotation, 1])
    sine = wp.int64(ballot.turns[rotation, 2])
    count = ballot.directions.shape[0]
    for e in range(count):
        low = (ballot.directions[e] + code - ballot.tolerance) & LAST
        y = wp.int64(ballot.vectors[e, 0])
        x = wp.int64(ballot.vectors[e, 1])
        line = slab * count + e
        windows[line, 0] = ballot.starts[low]
        windows[line, 1] = ballot.starts[low + 2 * ballot.tolerance + 1]
        windows[line, 2] = int((y * cosine + x * sine + HALF) >> BITS)
        windows[line, 3] = int((x * cosine - y * sine + HALF) >> BITS)


@wp.func
def copy_votes(
    slab: int, slice: int, ballot: Ballot, cells: wp.array2d[wp.uint16], votes: wp.array[int]
):
    """Write the votes of all cells of a slice."""
    rows = ((ballot.height - 1) >> ballot.shift) + 1
    columns = ((ballot.width - 1) >> ballot.shift) + 1
    for row in range(rows):
        for k in range(columns):
            votes[(slice * rows + row) * columns + k] = int(cells[slab, row * (columns + 1) + k])


@wp.kernel
def search(
    slab: int,
    first: int,
    last: int,
    ballot: Ballot,
    peaks: bool,
    # scratch
    windows: wp.array2d[int],  # (slabs N, 4): first point, point behind the last, turned vector
    cells: wp.array2d[wp.uint16],  # (slabs, cells of a slice with margin)
    # outputs
    found: wp.array[int],  # keys of the tiles, or votes of the cells, of the R S slices
):
    count = ballot.scales.shape[0]
    for slice in range(first, last):
        if slice == first or slice % count == 0:
            turn_entries(slab, slice // count, ballot, windows)
        vote_slice(slab, ballot.scales[slice % count], ballot, windows, cells)
        if peaks:
            find_peaks(slab, slice, ballot, cells, found)
        else:
            copy_votes(slab, slice, ballot, cells, found)
