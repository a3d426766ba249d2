"""Semi-global matching of two images, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.stereo import CENSUS_WEIGHT, DIFFERENCE_LIMIT, DIFFERENCE_SHIFT
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.stereo.costs._window_sums import ones
from cvkern.kernels.taichi.stereo.winners import _pick, _pick_right

from .aggregation import _aggregate

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
def match_costs(
    left_bits: np.ndarray,
    right_bits: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    costs: np.ndarray,
) -> None:
    """Compare census and grey value of the pixels of a pair; one thread per disparity."""
    _match_costs(left_bits, right_bits, left, right, first, costs)


@primitive
def match(
    left_bits: np.ndarray,
    right_bits: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    count: int,
    p1: int,
    p2: np.ndarray,
    p2_max: int,
    paths: int,
    subpixel: int,
    uniqueness: int,
    top: int,
    index: np.ndarray,
    disparity: np.ndarray,
    cost: np.ndarray,
    confidence: np.ndarray,
    right_index: np.ndarray,
) -> None:
    """Do `match_costs`, `aggregate` along the left image, `pick` and `pick_right`."""
    costs = scratch((*left.shape, count), np.uint8)
    sums = scratch((*index.shape, count), np.uint16)
    _match_costs(left_bits, right_bits, left, right, first, costs)
    _aggregate(costs, left, p1, p2, paths, top, sums)
    _pick(sums, first, subpixel, uniqueness, 0, index, disparity, cost, confidence)
    _pick_right(sums, first, right_index)
