"""Linear filters in Taichi: a correlation down the rows, then one along the columns."""

import numpy as np

from cvkern.kernels.taichi._launch import primitive, scratch

from ._separable import correlate_along, correlate_down
from .depths import narrow, widen


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
    """Correlate down the rows, then along the columns; one thread per element and pass.

    Both images are float32, or both are integers of 8 or 16 bits; then sums are rounded.
    """
    whole = dst.dtype != np.float32
    down = scratch(src.shape, np.float32)
    wide, sums = (scratch(src.shape, np.float32) for _ in "ab") if whole else (src, dst)
    if whole:
        widen(src, wide)
    correlate_down(wide, taps_y, border, cval, 0, down)
    correlate_along(down, taps_x, step, border, cval, 0, sums)
    if whole:
        narrow(sums, dst)
