"""Semi-global matching of two images, in Taichi.

The cost of a match is CENSUS_WEIGHT times the Hamming distance of two census transforms of 5 x 5
pixels, plus the difference of the grey values, shifted right by DIFFERENCE_SHIFT, but at most
DIFFERENCE_LIMIT. Costs and sums are stored as volumes: aggregation.py sums the costs, then
../winners.py picks the winners. One thread per cost.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.stereo import (
    CENSUS_WEIGHT,
    DIFFERENCE_LIMIT,
    DIFFERENCE_SHIFT,
    Penalties,
    Rule,
    View,
    Winners,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.stereo.costs._window_sums import ones
from cvkern.kernels.taichi.stereo.winners import _pick, _pick_right

from .aggregation import _aggregate, aggregation_bytes

u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
u64_2 = ti.types.ndarray(dtype=ti.u64, ndim=2)


@ti.kernel
def _match_costs(
    left_bits: u64_2,
    right_bits: u64_2,
    left: u8_2,
    right: u8_2,
    first: ti.i32,
    # outputs
    costs: u8_3,  # (H, W, D)
):
    for y, x, k in costs:
        there = ti.max(0, ti.min(costs.shape[1] - 1, x - first - k))
        count = ones(left_bits[y, x] ^ right_bits[y, there])
        grey = ti.abs(ti.cast(left[y, x], ti.i32) - ti.cast(right[y, there], ti.i32))
        limited = ti.min(grey >> DIFFERENCE_SHIFT, DIFFERENCE_LIMIT)
        costs[y, x, k] = ti.cast(CENSUS_WEIGHT * count + limited, ti.u8)


@primitive
def match_costs(left: View, right: View, first: int, costs: np.ndarray) -> None:
    """Compare census and grey value of the pixels of a pair; one thread per disparity."""
    _match_costs(left.bits, right.bits, left.gray, right.gray, first, costs)


@primitive
def match(
    left: View,
    right: View,
    count: int,
    penalties: Penalties,
    paths: int,
    rule: Rule,
    top: int,
    winners: Winners,
    right_index: np.ndarray,
) -> None:
    """Call `match_costs`, `aggregate` guided by the left image, `pick` and `pick_right`.

    There are `count` disparities; the winners are those of the rows from `top` on.
    """
    costs = scratch((*left.gray.shape, count), np.uint8)
    sums = scratch((*right_index.shape, count), np.uint16)
    _match_costs(left.bits, right.bits, left.gray, right.gray, rule.first, costs)
    _aggregate(costs, left.gray, penalties, paths, top, sums)
    _pick(sums, *rule, 0, *winners)
    _pick_right(sums, rule.first, right_index)


def matching_bytes(device: str, height: int, width: int, depth: int, paths: int, p2: int) -> int:
    """Return the bytes to allow for a whole match, costs and sums included.

    The result is that of the Warp set, so that both cut an image into the same strips of rows.
    """
    padded = -(-depth // 32) * 32
    right = height * (4 * (width + padded) + 4 * (width + 2 * padded))
    volumes = (2 if device == "cpu" else 3) * height * width * padded
    return aggregation_bytes(device, height, width, depth, paths, p2) + volumes + right
