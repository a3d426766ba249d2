"""Matching by windows. The winner is found without storing the costs."""

from __future__ import annotations

import math
from typing import Any

from cvkern._runtime import Runtime
from cvkern.kernels.codes.stereo import Cost, Rule, Winners
from cvkern.stereo.costs import census_words

# A census of 5 x 5 pixels, two pixels apart. On the pairs of tests/stereo/test_windows.py, it is
# better in windows of 7 and 11 pixels than a census of 5 x 5 or 7 x 9 adjacent pixels, and about
# equal in windows of 21. It is better than differences of values in all of these windows.
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

    The result is that of :func:`cvkern.stereo_cost` with ``cost="census", window=window,
    neighborhood=5, spacing=2``, followed by :func:`cvkern.winner_take_all`. All arrays are kernel
    arrays (H, W). The images are uint8 or float32; the outputs are those of the primitives `pick`
    and `pick_right`.
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
