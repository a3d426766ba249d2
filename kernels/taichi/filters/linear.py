"""Linear filters in Taichi: a correlation down the rows, then one along the columns."""

import numpy as np

from cvkern.kernels.taichi._launch import primitive, scratch

from ._separable import correlate_along, correlate_down


@primitive
def correlate_separable(
    src: np.ndarray,
    taps_y: np.ndarray,
    taps_x: np.ndarray,
    step: int,
    border: int,
    cval: float,
    dst: np.ndarray,
) -> None:
    """Correlate down the rows, then along the columns; one thread per element and pass."""
    down = scratch(src.shape, np.float32)
    correlate_down(src, taps_y, border, cval, 0, down)
    correlate_along(down, taps_x, step, border, cval, 0, dst)
