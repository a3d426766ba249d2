"""Costs summed over windows, in Taichi."""

import numpy as np

from cvkern.kernels.taichi._launch import primitive

from ._window_sums import sum_windows


@primitive
def window_costs(
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    cost: int,
    octets: int,
    radius_y: int,
    radius_x: int,
    costs: np.ndarray,
) -> None:
    """Sum a cost over windows of (H, W, C), down and along; one thread per sum.

    Pixels are uint8, float32, or, for CENSUS, uint64; its bits above the octets are 0.
    """
    sum_windows(left, right, first, cost, radius_y, radius_x, 0, costs)
