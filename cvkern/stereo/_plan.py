"""How a pair is matched: the options of :func:`cvkern.stereo_match`, checked, and the steps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    check_channel_axis,
    check_choice,
    check_disparities,
    check_integer,
    check_number,
    check_positive,
)
from cvkern._runtime import Runtime
from cvkern.kernels.codes.stereo import LARGEST_MATCH_COST, Subpixel
from cvkern.stereo._strips import Strip, cut_strips
from cvkern.stereo.costs import census_words
from cvkern.stereo.paths import MAX_COSTS, PATHS, check_sums, matching_bytes, penalties
from cvkern.stereo.refinement import MAX_RADIUS
from cvkern.stereo.windows import MAX_WINDOW, match_windows
from cvkern.stereo.winners import check_subpixel

METHODS = ("semi-global", "window")
CENSUS = (2, 2)  # radii, for semi-global matching
GUIDE_CONTRAST = 40  # of the median

Winners = tuple[Any, Any, Any, Any, Any]  # what the primitives `pick` and `pick_right` fill


class Plan(NamedTuple):
    """The checked options for pairs of one shape."""

    shape: tuple[int, int]
    axis: int | None  # of the channels
    channels: int
    first: int
    stop: int
    method: str
    paths: int
    window: int
    data_range: float | None
    p1: int
    p2: int
    contrast: float
    fit: Subpixel
    uniqueness: int
    left_right: float | None
    speckle_size: int
    speckle_difference: float
    smoothing: int
    max_bytes: int | None

    def match(
        self, rt: Runtime, left: Any, right: Any, disparity: Any, valid: Any, confidence: Any
    ) -> None:
        """Fill the kernel arrays of a result."""
        strips = self.strips(rt.device)  # raises before any kernel runs
        gray = self._gray(rt, "left", left)
        outputs = _, found, _, _, right_index = (
            rt.scratch("stereo.index", self.shape, np.int32),
            rt.scratch("stereo.found", self.shape),
            rt.scratch("stereo.cost", self.shape),
            confidence,
            rt.scratch("stereo.right_index", self.shape, np.int32),
        )
        other = self._gray(rt, "right", right)
        if self.method == "window":
            self._match_windows(rt, gray, other, outputs)
        else:
            self._match_paths(rt, gray, other, strips, outputs)
        checked = rt.scratch("stereo.checked", self.shape)
        if self.left_right is not None:
            rt.stereo.refinement.left_right(
                found, right_index, self.first, self.left_right, checked
            )
            found, checked = checked, found
        if self.speckle_size > 1:
            rt.stereo.refinement.remove_speckles(
                found, self.speckle_size, self.speckle_difference, checked
            )
            found, checked = checked, found
        if not self.smoothing:
            rt.stereo.refinement.fill(found, disparity, valid)
            return
        rt.stereo.refinement.fill(found, checked, valid)
        rt.stereo.refinement.guided_median(checked, gray, self.smoothing, GUIDE_CONTRAST, disparity)

    def _gray(self, rt: Runtime, name: str, image: Any) -> Any:
        """Return the grey values of an image in 8 bits."""
        lib = library(image)
        range_ = white(self.data_range, lib.dtype(image))
        dtype = np.dtype(np.uint8 if lib.dtype(image) == np.uint8 and range_ == 255 else np.float32)
        image = image if self.axis in (None, 2) else lib.last(image, self.axis)
        pixels = rt.adopt(image, dtype, (*self.shape, self.channels))
        if dtype == np.uint8 and self.channels == 1:
            return pixels.reshape(self.shape)
        gray = rt.scratch(f"stereo.gray.{name}", self.shape, np.uint8)
        rt.stereo.costs.gray.gray_bytes(pixels, float(np.float32(255 / range_)), gray)
        return gray

    def _match_windows(self, rt: Runtime, left: Any, right: Any, outputs: Winners) -> None:
        """Match by windows."""
        index, disparity, cost, confidence, right_index = outputs
        match_windows(
            rt, left, right, (self.first, self.stop), self.window, self.fit, self.uniqueness,
            index, disparity, cost, confidence, right_index,
        )  # fmt: skip

    def _match_paths(
        self, rt: Runtime, left: Any, right: Any, strips: list[Strip], outputs: Winners
    ) -> None:
        """Match semi-globally, in strips of rows if memory is bounded."""
        census = [
            census_words(
                rt, f"stereo.census.{name}", gray.reshape((*self.shape, 1)), CENSUS, 1, False
            ).reshape(self.shape)
            for name, gray in (("left", left), ("right", right))
        ]
        table = rt.constant(penalties(self.p1, self.p2, self.contrast))
        for strip in strips:
            left_bits, right_bits, left_gray, right_gray = (
                strip.seen_of(a) for a in (*census, left, right)
            )
            index, disparity, cost, confidence, right_index = (strip.kept_of(a) for a in outputs)
            rt.stereo.paths.matching.match(
                left_bits, right_bits, left_gray, right_gray, self.first, self.stop - self.first,
                self.p1, table, self.p2, self.paths, self.fit, self.uniqueness, strip.margin,
                index, disparity, cost, confidence, right_index,
            )  # fmt: skip

    def strips(self, device: str) -> list[Strip]:
        """Return the strips of rows that semi-global paths are walked in."""
        height, width = self.shape
        depth = self.stop - self.first

        def work(rows: int) -> int:
            if self.method == "window":
                return 0
            return matching_bytes(device, rows, width, depth, self.paths, self.p2)

        subject = f"{height} x {width} pixels and {depth} disparities"
        return cut_strips(height, 0, work, self.max_bytes, subject)


def plan_of(
    shape: tuple[int, ...],
    disparities: tuple[int, int],
    method: str,
    paths: int,
    window: int,
    channel_axis: int | None,
    data_range: float | None,
    p1: int,
    p2: int,
    contrast: float,
    subpixel: bool | str,
    uniqueness: int,
    left_right: float | None,
    speckle_size: int,
    speckle_difference: float,
    smoothing: int,
    max_bytes: int | None,
) -> Plan:
    """Check the options of :func:`cvkern.stereo_match`."""
    axis = check_channel_axis(shape, channel_axis)
    height, width = (n for i, n in enumerate(shape) if i != axis)
    channels = 1 if axis is None else shape[axis]
    if channels not in ((1,) if axis is None else (3, 4)):
        raise ValueError(f"channel_axis must be of 3 or 4 channels, got {channels}")
    first, stop = check_disparities(disparities, width)
    check_choice(method, METHODS, "method")
    if paths not in PATHS:
        raise ValueError(f"paths must be one of {PATHS}, got {paths!r}")
    window = check_integer(window, "window", 1, MAX_WINDOW)
    if window % 2 == 0:
        raise ValueError(f"window must be odd, got {window}")
    if data_range is not None:
        data_range = check_positive(data_range, "data_range")
    p1 = check_integer(p1, "p1", 0, 2**14)
    p2 = check_integer(p2, "p2", 0, 2**14)
    if p1 > p2:
        raise ValueError(f"p1 must be <= p2, got {p1} > {p2}")
    check_sums(paths, LARGEST_MATCH_COST, p2)
    volume = height, width, stop - first
    if method == "semi-global" and math.prod(volume) > MAX_COSTS:
        size = " x ".join(map(str, volume))
        raise ValueError(
            f"disparities must make at most {MAX_COSTS} costs, "
            f"got {size} of {2 * math.prod(volume)} bytes"
        )
    if left_right is not None:
        left_right = check_number(left_right, "left_right", low=0)
    plan = Plan(
        (height, width),
        axis,
        channels,
        first,
        stop,
        method,
        paths,
        window,
        data_range,
        p1,
        p2,
        check_positive(contrast, "contrast"),
        check_subpixel(subpixel),
        check_integer(uniqueness, "uniqueness", 0, 99),
        left_right,
        check_integer(speckle_size, "speckle_size", 0, 2**31 - 1),
        check_number(speckle_difference, "speckle_difference", low=0),
        check_integer(smoothing, "smoothing", 0, MAX_RADIUS),
        max_bytes,
    )
    plan.strips("cpu")  # raises where max_bytes are too few for any device
    return plan


def white(data_range: float | None, dtype: np.dtype) -> float:
    """Return the value of white in images of `dtype`."""
    if data_range is not None:
        return data_range
    return float(np.iinfo(dtype).max) if dtype.kind in "iu" else 1.0
