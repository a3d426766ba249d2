"""Zero-mean normalised cross-correlation of windows, in Taichi."""

import numpy as np

from cvkern.kernels.taichi._launch import primitive

from ._correlation import correlate_windows


@primitive
def correlation(
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    radius_y: int,
    radius_x: int,
    costs: np.ndarray,
) -> None:
    """Compute 1 minus the correlation of windows, with a mean per channel; one thread per cost."""
    correlate_windows(left, right, first, radius_y, radius_x, costs)
