"""Semi-global aggregation of stored costs on the CPU: the sweeps of _steps_cpu.py.

aggregation.py has the equation. The first sweep stores its sums, later ones add theirs.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

from ._steps_cpu import OPTIONS, WORD, Course, Paths, constants, work_of


@lru_cache
def sweep(scalar: Any, paths: Paths) -> wp.Kernel:
    """Return the kernel for costs of one type and some paths."""
    work_type = work_of(WORD)

    @_native.kernel("_aggregation_cpu.h", OPTIONS, TYPE=scalar, **constants(paths, WORD))
    def sweep(
        slab: int,
        first: int,
        last: int,
        volume: wp.array3d[scalar],  # (H, W, D)
        guide: wp.array2d[wp.uint8],  # (H, W) or (1, 1)
        course: Course,
        # scratch
        work: work_type,
        # outputs
        sums: wp.array3d[wp.uint16],  # (h, W, D), of the volume's rows from `top` on
    ): ...

    return sweep
