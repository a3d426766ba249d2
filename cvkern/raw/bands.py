"""A local Laplacian filter: edges shrink, details stay."""

from __future__ import annotations

import math
from typing import Any

from cvkern._runtime import Runtime


def local_laplacian(
    rt: Runtime,
    logs: Any,
    lowest: float,
    step: float,
    references: int,
    sigma: float,
    slope: float,
) -> Any:
    """Return the kernel array (1, H, W), filtered [Aubry et al. 2014].

    Variations within `sigma` stay, larger ones count by `slope`. The references, at which bands are
    computed, are `lowest` and so many more steps.
    """
    _, *shape = logs.shape
    kernels = rt.raw.bands
    levels = [logs]
    for n in range(max(1, int(math.log2(min(shape))))):
        shape = [(size + 1) // 2 for size in shape]
        levels.append(rt.scratch(f"bands.level{n}", (references + 2, *shape)))
    kernels.begin(logs[0], lowest, step, sigma, slope, levels[1])
    kernels.reduce(levels[1:], references + 1)
    result = rt.scratch("bands.result", tuple(logs.shape))
    kernels.collapse(levels, lowest, step, sigma, slope, result)
    return result
