"""Bilateral filtering on a grid of space and brightness."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.filters.linear import gaussian_taps


def bilateral(
    rt: Runtime, logs: Any, lowest: float, span: float, sigma: float, reach: float, sums: Any
) -> Any:
    """Return the kernel array of (H, W) values, smoothed where they differ by less than `reach`.

    Values begin at `lowest` and extend over `span`; `sigma` is in pixels. The grid has a cell for
    each of both. What remains is measured in `sums`.
    """
    space, depth = np.float32(1 / sigma), np.float32(1 / reach)
    ends = ((logs.shape[0] - 1) * space, (logs.shape[1] - 1) * space, span * depth)
    shape = tuple(int(math.floor(float(end) + 1e-3) + 6) for end in ends)
    kernels = rt.raw.grids
    cells = rt.scratch("grids.cells", (*shape, 2), np.int64)
    one, two = (rt.scratch(f"grids.{n}", (*shape, 2)) for n in ("one", "two"))
    rt.clear(cells)
    taps = rt.constant(gaussian_taps(1.0))
    kernels.fill(logs, lowest, float(space), float(depth), taps, cells, one)
    smoothed = rt.scratch("grids.smoothed", (*shape, 2))
    kernels.smooth(one, taps, two, smoothed)
    base = rt.scratch("grids.base", tuple(logs.shape))
    kernels.read(logs, smoothed, lowest, float(space), float(depth), base, sums)
    return base
