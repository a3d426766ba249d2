"""Matching costs: volumes of windows of a rectified pair."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Work, unequal

from .matching import disparities, pair

WINDOW = 11


def _slices(left: Any, right: Any, gap: Any) -> Any:
    """Yield the differences of each disparity, images continued by their nearest pixels."""
    reach = WINDOW // 2
    height, width = left.shape
    rows = np.arange(-reach, height + reach).clip(0, height - 1)[:, None]
    columns = np.arange(-reach, width + reach)
    wide = left[rows, columns.clip(0, width - 1)]
    for d in range(disparities(left.shape)):
        yield gap(wide, right[rows, (columns - d).clip(0, width - 1)])


def _numpy(np: Any, left: Any, right: Any) -> Any:
    """Sum by running sums in both directions, a disparity at a time."""
    costs = np.empty((*left.shape, disparities(left.shape)), np.uint16)
    below = left.astype(np.int32), right.astype(np.int32)
    for k, gap in enumerate(_slices(*below, lambda a, b: np.abs(a - b))):
        sums = np.pad(gap, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
        sums = sums[WINDOW:] - sums[:-WINDOW]
        costs[..., k] = sums[:, WINDOW:] - sums[:, :-WINDOW]
    return costs


def _opencv(cv2: Any, left: Any, right: Any) -> Any:
    """Sum by its box filter, a disparity at a time."""
    costs = np.empty((*left.shape, disparities(left.shape)), np.uint16)
    reach = WINDOW // 2
    for k, gap in enumerate(_slices(left, right, cv2.absdiff)):
        sums = cv2.boxFilter(gap, cv2.CV_32S, (WINDOW, WINDOW), normalize=False)
        costs[..., k] = sums[reach:-reach, reach:-reach]
    return costs


CASES = (
    Case(
        name="stereo_cost_sad",
        title="Absolute differences in windows of 11 x 11, uint8",
        image=pair,
        call=lambda left, right: cvkern.stereo_cost(
            left, right, (0, disparities(left.shape)), cost="sad", window=WINDOW
        ),
        oracle=lambda left, right: _numpy(np, left, right),
        oracle_name="running sums of NumPy",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=2 + 2 * 128,  # for 128 disparities
        operations_per_pixel=128 * 6,
        peers=(
            Peer("NumPy", "numpy", _numpy),
            Peer("OpenCV", "cv2", _opencv, note="a box filter for each disparity"),
        ),
        work=Work("DE", lambda left, right: left.size * disparities(left.shape)),
        sizes=("1024x440",),
        most_inputs=2,
        margin=0,
    ),
)
