"""Matching by windows: the winner among their costs, which are never stored."""

from __future__ import annotations

import math
from typing import Any

from cvkern._runtime import Runtime
from cvkern.kernels.codes.stereo import Cost, Rule, Winners
from cvkern.stereo.costs import census_words

# A census of 5 x 5 pixels two apart. In windows of 7 and of 11 pixels it matches the pairs of
# tests/stereo/test_windows.py better than a census of 5 x 5 or 7 x 9 neighbours does, in windows of
# 21 about as well, and better than differences of values in all.
RADII, SPACING, OCTETS = (2, 2), 2, 3
BITS = 24


def max_window(rt: Runtime) -> int:
    """Return the largest odd side of a window, in pixels, whose costs kernels can sum."""
    side = math.isqrt(rt.stereo.windows.max_sum() // BITS)
    return side - 1 + side % 2


def match_windows(
    rt: Runtime,
    left: Any,
    right: Any,
    count: int,
    window: int,
    rule: Rule,
    winners: Winners,
    right_index: Any,
) -> None:
    """Match grey images by the census of their windows, at `count` disparities.

    As :func:`cvkern.stereo_cost` with ``cost="census", window=window, neighborhood=5, spacing=2``,
    then :func:`cvkern.winner_take_all`. All arrays are kernel arrays (H, W): the images uint8 or
    float32; the outputs as those of the primitives `pick` and `pick_right`.
    """
    one, other = (
        census_words(
            rt, f"window_matching.{side}", image.reshape((*image.shape, 1)), RADII, SPACING, False
        )
        for side, image in (("left", left), ("right", right))
    )
    radius = window // 2
    rt.stereo.windows.match_windows(
        one, other, count, Cost.CENSUS, OCTETS, radius, radius, rule, winners, right_index
    )
