"""Matching by windows, in Taichi.

The costs of costs/windows.py are stored for one strip of rows at a time; winners.py then picks the
winners of the strip.
"""

import numpy as np

from cvkern.kernels.codes.stereo import Rule, Winners
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.stereo.costs._window_sums import strip_rows, sum_windows

from .winners import pick, pick_right


@primitive
def match_windows(
    left: np.ndarray,
    right: np.ndarray,
    count: int,
    cost: int,
    octets: int,
    radius_y: int,
    radius_x: int,
    rule: Rule,
    winners: Winners,
    right_index: np.ndarray,
) -> None:
    """Call `window_costs`, `pick` and `pick_right` strip by strip; sums must be below 65535."""
    height, width, _ = left.shape
    rows = strip_rows(height, width * count)
    for top in range(0, height, rows):
        strip = slice(top, top + rows)
        costs = scratch((len(right_index[strip]), width, count), np.uint16)
        sum_windows(left, right, rule.first, cost, radius_y, radius_x, top, costs)
        pick(costs, rule, Winners(*(a[strip] for a in winners)))
        pick_right(costs, rule.first, right_index[strip])


def max_sum() -> int:
    """Return the largest sum of costs that a window may have."""
    return 2**16 - 2
