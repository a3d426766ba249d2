"""Winner takes all on the CPU, one thread per slab of rows.

_winner.h has the rule. The costs of a pixel are copied to a line of uint16 or float32
(_line_cpu.h). Vectors of 64 bytes find the smallest cost there, then its first place, then the
smallest cost of all places that are not adjacent to it. The code is native, because a loop over
single costs takes several times as long.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.warp import _native

from ._winner import CURVES, OPTIONS, WinnerArrays, WinnerRule


class Kind(NamedTuple):
    """The numbers in the line of a pixel's costs."""

    scalar: Any
    """Type of a cost."""
    place: Any
    """An unsigned integer of the same size."""
    constants: dict[str, Any]
    """The constants of _line_cpu.h and _winner.h."""


INTEGER = Kind(
    wp.uint16,
    wp.uint16,
    {
        "COST": wp.uint16,
        "PLACE": wp.uint16,
        "WIDE": wp.int32,
        "MOST": "0xffff",
        **CURVES,
    },
)
REAL = Kind(
    wp.float32,
    wp.uint32,
    {
        "COST": wp.float32,
        "PLACE": wp.uint32,
        "WIDE": wp.float32,
        "MOST": "__builtin_inff()",
        **CURVES,
    },
)


def padded(depth: int) -> int:
    """Return the length of a pixel's line of costs: whole vectors of each type."""
    return -(-depth // 32) * 32


def kind_of(scalar: Any) -> Kind:
    """Return the kind of line that holds costs of one type."""
    return REAL if scalar is wp.float32 else INTEGER


@lru_cache
def pick(scalar: Any) -> wp.Kernel:
    """Return the kernel for costs of one type."""
    kind = kind_of(scalar)
    line = kind.scalar

    @_native.kernel("_winners_cpu.h", OPTIONS, TYPE=scalar, **kind.constants)
    def pick(
        slab: int,
        first_row: int,
        last_row: int,
        costs: wp.array3d[scalar],  # (H, W, D)
        rule: WinnerRule,
        # scratch
        lines: wp.array2d[line],  # (slabs, padded)
        # outputs
        winners: WinnerArrays,
    ): ...

    return pick


@lru_cache
def pick_right(scalar: Any) -> wp.Kernel:
    """Return the kernel for costs of one type."""
    kind = kind_of(scalar)
    line, number = kind.scalar, kind.place

    @_native.kernel("_winners_cpu.h", OPTIONS, TYPE=scalar, **kind.constants)
    def pick_right(
        slab: int,
        first_row: int,
        last_row: int,
        costs: wp.array3d[scalar],  # (H, W, D)
        first: int,
        # scratch
        lines: wp.array2d[line],  # (slabs, padded)
        best: wp.array2d[line],  # (slabs, W + 2 padded)
        place: wp.array2d[number],  # (slabs, W + 2 padded)
        # outputs
        index: wp.array2d[int],  # (H, W)
    ): ...

    return pick_right
