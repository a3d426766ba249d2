"""The generalised Hough transform on CUDA: one block per slice, or per rectangle of a slice.

As on the CPU, an edge point p votes with an entry of vector v for the centre p + s R(t) v. A slice
is one rotation and one scale. Its accumulator is in shared memory, and its peaks are found there.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, TILE
from cvkern.kernels.warp import _native

from ._ballot import SCALED_BITS, TURNED_BITS, Ballot

wp.set_module_options({"enable_backward": False})

BLOCK = 256  # threads of a block; Warp's own
WORDS = 11904  # words of shared memory; with Warp's own 1 KB, less than the 48 KB of a block
CELLS = 2 * WORDS
assert TILE * TILE == 2 * 32, "a lane takes two cells of a tile"


def rectangle(rows: int, columns: int) -> tuple[int, int, int]:
    """Return rows and columns of the fewest rectangles that hold a slice, and their number."""
    best = None
    for abreast in range(1, -(-columns // TILE) + 1):
        wide = -(-columns // (abreast * TILE)) * TILE
        deep = min(CELLS // (wide + 2) - 1, rows + TILE - 1) // TILE * TILE
        if deep > 0:
            number = -(-rows // deep) * -(-columns // wide)
            if best is None or number < best[2]:
                best = deep, wide, number
            elif wide < 64:  # narrower rectangles do not reduce their number
                break
    assert best is not None
    return best


def _search(peaks: bool) -> wp.Kernel:
    """Return the kernel that writes the peaks of all tiles, or the votes of all cells."""

    @_native.kernel(
        "_votes_cuda.cu",
        BLOCK=BLOCK,
        WORDS=WORDS,
        DIRECTIONS=DIRECTIONS,
        TURNED_BITS=TURNED_BITS,
        SCALED_BITS=SCALED_BITS,
        TILE=TILE,
        PEAKS=int(peaks),
    )
    def search(
        ballot: Ballot,
        deep: int,
        wide: int,
        # outputs
        found: wp.array[int],  # keys of the tiles, or votes of the cells, of the R S slices
    ): ...

    return search


searches = {peaks: _search(peaks) for peaks in (True, False)}
