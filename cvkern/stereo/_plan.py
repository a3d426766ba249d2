"""The matching of a pair: the checked options of :func:`cvkern.stereo_match`, and its steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    check_choice,
    check_colors,
    check_disparities,
    check_integer,
    check_number,
    check_positive,
)
from cvkern._runtime import Runtime
from cvkern._whites import white_of
from cvkern.kernels.codes.stereo import (
    LARGEST_MATCH_COST,
    MAX_COSTS,
    Penalties,
    Rule,
    View,
    Winners,
)
from cvkern.stereo._strips import Strip, cut_strips
from cvkern.stereo.costs import census_words
from cvkern.stereo.paths import check_paths, check_penalties, check_sums, penalties
from cvkern.stereo.windows import match_windows, max_window
from cvkern.stereo.winners import check_subpixel

METHODS = ("semi-global", "window")
CENSUS = (2, 2)  # radii of the census of semi-global matching
GUIDE_CONTRAST = 40  # contrast of the guided median


class Images(NamedTuple):
    """Shape, channels and range of the images of a pair."""

    shape: tuple[int, int]
    axis: int | None
    """Axis of the channels."""
    channels: int
    data_range: float | None

    def gray(self, rt: Runtime, name: str, image: Any) -> Any:
        """Return the grey values of an image as 8-bit integers."""
        lib = library(image)
        range_ = white_of(image, self.data_range)
        dtype = np.dtype(np.uint8 if lib.dtype(image) == np.uint8 and range_ == 255 else np.float32)
        image = image if self.axis in (None, 2) else lib.last(image, self.axis)
        pixels = rt.adopt(image, dtype, (*self.shape, self.channels))
        if dtype == np.uint8 and self.channels == 1:
            return pixels.reshape(self.shape)
        gray = rt.scratch(f"stereo.gray.{name}", self.shape, np.uint8)
        rt.stereo.costs.gray.gray_bytes(pixels, float(np.float32(255 / range_)), gray)
        return gray


class Paths(NamedTuple):
    """The options of semi-global paths."""

    directions: int
    p1: int
    p2: int
    contrast: float


class Refinement(NamedTuple):
    """The options of the steps after matching."""

    left_right: float | None
    speckle_size: int
    speckle_difference: float
    smoothing: int


class Plan(NamedTuple):
    """The checked options for pairs of one shape."""

    images: Images
    depth: int
    """Number of disparities."""
    rule: Rule
    method: str
    paths: Paths
    window: int
    refinement: Refinement
    max_bytes: int | None

    def match(
        self, rt: Runtime, left: Any, right: Any, disparity: Any, valid: Any, confidence: Any
    ) -> None:
        """Match a pair, and fill the kernel arrays of the result."""
        strips = self.strips(rt)  # raises before any kernel runs
        shape = self.images.shape
        gray = self.images.gray(rt, "left", left)
        winners = Winners(
            rt.scratch("stereo.index", shape, np.int32),
            rt.scratch("stereo.found", shape),
            rt.scratch("stereo.cost", shape),
            confidence,
        )
        right_index = rt.scratch("stereo.right_index", shape, np.int32)
        other = self.images.gray(rt, "right", right)
        if self.method == "window":
            match_windows(rt, gray, other, self.depth, self.window, self.rule, winners, right_index)
        else:
            self._match_paths(rt, gray, other, strips, winners, right_index)
        self._refine(rt, winners.disparity, right_index, gray, disparity, valid)

    def _match_paths(
        self,
        rt: Runtime,
        left: Any,
        right: Any,
        strips: list[Strip],
        winners: Winners,
        right_index: Any,
    ) -> None:
        """Match semi-globally, in strips of rows if memory is bounded."""
        shape = self.images.shape
        views = [
            View(
                census_words(
                    rt, f"stereo.census.{name}", gray.reshape((*shape, 1)), CENSUS, 1, False
                ).reshape(shape),
                gray,
            )
            for name, gray in (("left", left), ("right", right))
        ]
        directions, p1, p2, contrast = self.paths
        costs = Penalties(p1, rt.constant(penalties(p1, p2, contrast)), p2)
        for strip in strips:
            one, another = (View(*map(strip.seen_of, view)) for view in views)
            rt.stereo.paths.matching.match(
                one, another, self.depth, costs, directions, self.rule, strip.margin,
                Winners(*map(strip.kept_of, winners)), strip.kept_of(right_index),
            )  # fmt: skip

    def _refine(
        self, rt: Runtime, found: Any, right_index: Any, gray: Any, disparity: Any, valid: Any
    ) -> None:
        """Check, fill and smooth the disparities that were found."""
        steps = rt.stereo.refinement
        left_right, size, difference, smoothing = self.refinement
        checked = rt.scratch("stereo.checked", self.images.shape)
        if left_right is not None:
            steps.agreement.left_right(found, right_index, self.rule.first, left_right, checked)
            found, checked = checked, found
        if size > 1:
            steps.speckles.remove_speckles(found, size, difference, checked)
            found, checked = checked, found
        if not smoothing:
            steps.gaps.fill(found, disparity, valid)
            return
        steps.gaps.fill(found, checked, valid)
        steps.medians.guided_median(checked, gray, smoothing, GUIDE_CONTRAST, disparity)

    def strips(self, rt: Runtime) -> list[Strip]:
        """Return the strips of rows in which semi-global paths are computed."""
        height, width = self.images.shape

        def work(rows: int) -> int:
            if self.method == "window":
                return 0
            return rt.stereo.paths.matching.matching_bytes(
                rt.device, rows, width, self.depth, self.paths.directions, self.paths.p2
            )

        subject = f"{height} x {width} pixels and {self.depth} disparities"
        return cut_strips(height, 0, work, self.max_bytes, subject)


def plan_of(rt: Runtime, shape: tuple[int, ...], given: Mapping[str, Any]) -> Plan:
    """Check the options of :func:`cvkern.stereo_match`, by name, for images of one shape."""
    axis = check_colors(shape, given["channel_axis"])
    height, width = (n for i, n in enumerate(shape) if i != axis)
    channels = 1 if axis is None else shape[axis]
    if channels not in ((1,) if axis is None else (3, 4)):
        raise ValueError(f"channel_axis must have 3 or 4 channels, got {channels}")
    first, stop = check_disparities(given["disparities"], width)
    method = check_choice(given["method"], METHODS, "method")
    paths = check_paths(given["paths"])
    window = check_integer(given["window"], "window", 1, max_window(rt))
    if window % 2 == 0:
        raise ValueError(f"window must be odd, got {window}")
    data_range = given["data_range"]
    if data_range is not None:
        data_range = check_positive(data_range, "data_range")
    p1, p2 = check_penalties(given["p1"], given["p2"])
    check_sums(paths, LARGEST_MATCH_COST, p2)
    volume = height, width, stop - first
    if method == "semi-global" and math.prod(volume) > MAX_COSTS:
        size = " x ".join(map(str, volume))
        raise ValueError(
            f"disparities must make at most {MAX_COSTS} costs, "
            f"got {size} of {2 * math.prod(volume)} bytes"
        )
    left_right = given["left_right"]
    if left_right is not None:
        left_right = check_number(left_right, "left_right", low=0)
    contrast = check_positive(given["contrast"], "contrast")
    fit = check_subpixel(given["subpixel"])
    uniqueness = check_integer(given["uniqueness"], "uniqueness", 0, 99)
    refinement = Refinement(
        left_right,
        check_integer(given["speckle_size"], "speckle_size", 0, 2**31 - 1),
        check_number(given["speckle_difference"], "speckle_difference", low=0),
        check_integer(
            given["smoothing"], "smoothing", 0, rt.stereo.refinement.medians.max_radius()
        ),
    )
    plan = Plan(
        Images((height, width), axis, channels, data_range),
        stop - first,
        Rule(first, fit, uniqueness),
        method,
        Paths(paths, p1, p2, contrast),
        window,
        refinement,
        given["max_bytes"],
    )
    plan.strips(rt)  # raises if max_bytes is too small
    return plan
