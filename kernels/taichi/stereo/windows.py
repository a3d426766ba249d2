"""Matching by windows, a strip of rows at a time, in Taichi."""

import numpy as np

from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.stereo.costs._window_sums import strip_rows, sum_windows

from .winners import pick, pick_right


@primitive
def match_windows(
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    count: int,
    cost: int,
    octets: int,
    radius_y: int,
    radius_x: int,
    subpixel: int,
    uniqueness: int,
    index: np.ndarray,
    disparity: np.ndarray,
    cost_of_index: np.ndarray,
    confidence: np.ndarray,
    right_index: np.ndarray,
) -> None:
    """Do `window_costs`, `pick` and `pick_right` a strip at a time; sums must be below 65535."""
    height, width, _ = left.shape
    rows = strip_rows(height, width * count)
    for top in range(0, height, rows):
        strip = slice(top, top + rows)
        costs = scratch((len(index[strip]), width, count), np.uint16)
        sum_windows(left, right, first, cost, radius_y, radius_x, top, costs)
        winners = index[strip], disparity[strip], cost_of_index[strip], confidence[strip]
        pick(costs, first, subpixel, uniqueness, *winners)
        pick_right(costs, first, right_index[strip])
