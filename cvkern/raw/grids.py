"""Bilateral filtering on a grid of space and brightness."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.filters.linear import gaussian_taps


def bilateral(
    rt: Runtime, logs: Any, lowest: float, span: float, sigma: float, reach: float
) -> Any:
    """Return the kernel array of (H, W) values, smoothed where they differ by less than `reach`.

    Values begin at `lowest` and extend over `span`; `sigma` is in pixels. The grid has a cell for
    each of both.
    """
    space, depth = np.float32(1 / sigma), np.float32(1 / reach)
    ends = ((logs.shape[0] - 1) * space, (logs.shape[1] - 1) * space, span * depth)
    shape = tuple(int(math.floor(float(end) + 1e-3) + 6) for end in ends)
    kernels = rt.raw.grids
    cells = rt.scratch("grids.cells", (*shape, 2), np.int64)
    one, two = (rt.scratch(f"grids.{n}", (*shape, 2)) for n in ("one", "two"))
    rt.clear(cells)
    kernels.fill(logs, lowest, float(space), float(depth), cells)
    taps = rt.constant(gaussian_taps(1.0))
    kernels.smooth_depth(cells, taps, one)
    kernels.smooth(one, taps, 0, two)
    kernels.smooth(two, taps, 1, one)
    base = rt.scratch("grids.base", tuple(logs.shape))
    kernels.read(logs, one, lowest, float(space), float(depth), base)
    return base
