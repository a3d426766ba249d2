"""Matching by windows: the winner among their costs, which are never stored."""

from __future__ import annotations

from typing import Any

from cvkern._runtime import Runtime
from cvkern.kernels.codes.stereo import Cost, Subpixel
from cvkern.stereo.costs import census_words

# A census of 5 x 5 pixels two apart. Summed over windows of 7 or 11 pixels it matched the pairs of
# tests/test_window_matching.py better than one of 5 x 5 or 7 x 9 neighbours, over 21 as well, and
# over each better than differences of values.
RADII, SPACING, OCTETS = (2, 2), 2, 3
MAX_WINDOW = 51  # pixels a side: 24 * 51^2 < 65535


def match_windows(
    rt: Runtime,
    left: Any,
    right: Any,
    disparities: tuple[int, int],
    window: int,
    subpixel: Subpixel,
    uniqueness: int,
    index: Any,
    disparity: Any,
    cost: Any,
    confidence: Any,
    right_index: Any,
) -> None:
    """Match grey images by the census of their windows.

    As :func:`cvkern.stereo_cost` with ``cost="census", window=window, neighborhood=5, spacing=2``,
    then :func:`cvkern.winner_take_all`. All arrays are kernel arrays (H, W): the images uint8 or
    float32; the outputs as those of the primitives `pick` and `pick_right`.
    """
    first, stop = disparities
    one, other = (
        census_words(
            rt, f"window_matching.{side}", image.reshape((*image.shape, 1)), RADII, SPACING, False
        )
        for side, image in (("left", left), ("right", right))
    )
    radius = window // 2
    rt.stereo.windows.match_windows(
        one, other, first, stop - first, Cost.CENSUS, OCTETS, radius, radius, subpixel, uniqueness,
        index, disparity, cost, confidence, right_index,
    )  # fmt: skip
