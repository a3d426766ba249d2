"""Matching by windows without a volume of costs, in Warp."""

import warp as wp

from . import _window_rows as rows
from ._launch import launch_slabs, scratch, slabs


def match_windows(
    left: wp.array,
    right: wp.array,
    first: int,
    count: int,
    cost: int,
    octets: int,
    radius_y: int,
    radius_x: int,
    subpixel: int,
    uniqueness: int,
    index: wp.array,
    disparity: wp.array,
    cost_of_index: wp.array,
    confidence: wp.array,
    right_index: wp.array,
) -> None:
    """Do `window_costs`, `pick` and `pick_right` a row at a time; sums must be below 65535."""
    height, width, _ = left.shape
    parts = slabs(height, height * width * count)
    inner = rows.slab_scratch(left, parts, count, cost, octets, radius_x, wp.uint16)
    reach = rows.padded(count, wp.uint16)
    sums = scratch("window.sums", (parts, width * reach + 2), wp.uint16, left.device)
    rights = scratch("window.rights", (parts, 2 * (width + reach)), wp.uint16, left.device)
    launch_slabs(
        rows.match_windows(cost, left.dtype),
        height,
        parts,
        [left, right, first, count, octets, radius_y, radius_x, subpixel, uniqueness,
         *inner, sums, rights],
        [index, disparity, cost_of_index, confidence, right_index],
    )  # fmt: skip
