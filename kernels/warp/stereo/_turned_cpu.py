"""Constants of _turned_cpu.h: winners of many pixels at once, on the CPU."""

from collections.abc import Iterable

import warp as wp

from ._winner import CURVES

TILE = 32  # pixels and disparities that are transposed at a time


def _by_turns(begins: Iterable[int], size: int, step: int) -> str:
    """Return the interleaved places of two vectors, `step` of each at a time.

    They are the `size` places that begin at each of `begins`.
    """
    pieces = (range(i, i + step) for begin in begins for i in range(begin, begin + size, step))
    return ", ".join(str(i + other) for piece in pieces for other in (0, TILE) for i in piece)


CONSTANTS = {
    **CURVES,
    "WIDE": wp.int32,
    "TILE": TILE,
    "LOW_HALVES": _by_turns(range(0, TILE, 8), 4, 1),
    "HIGH_HALVES": _by_turns(range(4, TILE, 8), 4, 1),
    "FIRST_BLOCKS": _by_turns([0], TILE // 2, 8),
    "LAST_BLOCKS": _by_turns([TILE // 2], TILE // 2, 8),
}
