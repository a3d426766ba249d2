"""Every error of stereo: costs, aggregation, winners, matching."""

from typing import Any

import numpy as np
import pytest

import cvkern
from tests.refusals import DEEP, FLAT, refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

# --- stereo costs --------------------------------------------------------------------------------


def cost_refused(
    error: Any,
    message: str,
    left: Any = FLAT,
    right: Any = FLAT,
    disparities: Any = (0, 3),
    **options: Any,
) -> None:
    refused(error, message, cvkern.stereo_cost, left, right, disparities, **options)


def test_pairs():
    cost_refused(ValueError, "left must be 2-D or 3-D, got shape (2,)", [1, 2])
    cost_refused(ValueError, "right must not be empty, got shape (0, 5)", right=np.zeros((0, 5)))
    message = "right must hold real numbers, got dtype complex128"
    cost_refused(TypeError, message, right=FLAT.astype(complex))
    cost_refused(
        ValueError, "right must have the shape of left, (4, 5), got (5, 4)", right=np.zeros((5, 4))
    )
    cost_refused(ValueError, "right must have the shape of left, (4, 5), got (4, 5, 3)", right=DEEP)
    message = "channel_axis must be given for 3-D images and for no others, got None for shape "
    other = np.zeros((4, 5, 2))
    cost_refused(ValueError, message + "(4, 5, 2)", other, other)
    cost_refused(ValueError, "channel_axis must be in [-3, 2], got 3", DEEP, DEEP, channel_axis=3)


def test_disparities():
    message = "disparities must be two integers, the first and the one after the last, got "
    for wrong in (64, (1, 2, 3), (0, 1.5), "ab", None, ()):
        cost_refused(TypeError, f"{message}{wrong!r}", disparities=wrong)
    for wrong in ((0, 0), (3, 1)):
        message = f"disparities must be (first, stop) with first < stop, got {wrong}"
        cost_refused(ValueError, message, disparities=wrong)
    for wrong in ((0, 6), (-5, 2), (0, 64)):
        message = f"disparities must be less than the width of 5 pixels, got {wrong}"
        cost_refused(ValueError, message, disparities=wrong)
    wide = np.broadcast_to(np.uint8(0), (1, 40000))
    message = "disparities must be at most 32768, got (0, 32769): 32769"
    cost_refused(ValueError, message, wide, wide, (0, 32769))
    large = np.broadcast_to(np.uint8(0), (4000, 3000))
    size = "4000 x 3000 x 500"
    message = f"disparities must make at most 2147483647 costs, got {size} of 6000000000 bytes"
    cost_refused(ValueError, message, large, large, (0, 500))
    message = message.replace("6000000000", "24000000000")
    cost_refused(ValueError, message, large, large, (0, 500), cost="zncc")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"cost": "ncc"},
            "cost must be one of ('sad', 'ssd', 'birchfield_tomasi', 'zncc', 'census', "
            "'census_symmetric'), got 'ncc'",
        ),
        ({"window": 0}, "window must be in [1, 1023], got 0"),
        ({"window": (3, 1024)}, "window must be in [1, 1023], got 1024"),
        ({"window": (3, 4)}, "window must have odd sides, got 4"),
        ({"window": (3, 5, 7)}, "window must be one number or two, got 3"),
        ({"neighborhood": 8}, "neighborhood must have odd sides, got 8"),
        ({"neighborhood": (1, 67)}, "neighborhood must be in [1, 65], got 67"),
        ({"neighborhood": 9}, "neighborhood must have 1 to 64 comparisons, got 80"),
        ({"neighborhood": 1}, "neighborhood must have 1 to 64 comparisons, got 0"),
        (
            {"neighborhood": 13, "cost": "census_symmetric"},
            "neighborhood must have 1 to 64 comparisons, got 84",
        ),
        ({"spacing": 0}, "spacing must be in [1, 16], got 0"),
        ({"spacing": 17}, "spacing must be in [1, 16], got 17"),
    ],
)
def test_options_of_stereo_costs(options, message):
    cost_refused(ValueError, message, **options)


def test_types_of_stereo_costs():
    cost_refused(TypeError, "window must be an integer, got 3.0", window=3.0)
    cost_refused(TypeError, "neighborhood must be an integer, got 'a'", neighborhood=("a", 3))
    cost_refused(TypeError, "spacing must be an integer, got None", spacing=None)


def test_sums_of_stereo_costs():
    flat = FLAT.astype(np.uint8)
    for cost in ("ssd", "zncc"):
        message = f"window must keep the sums of integers below 2^31, got up to {255**2 * 183**2}"
        cost_refused(ValueError, message, flat, flat, cost=cost, window=183)


# --- semi-global aggregation and winners ---------------------------------------------------------

COSTS: Any = np.zeros((4, 5, 6), np.uint8)


def sums_refused(error, message, costs=COSTS, p1: Any = 5, p2: Any = 20, **options):
    refused(error, message, cvkern.aggregate_semi_global, costs, p1, p2, **options)


@pytest.mark.parametrize("function", ["aggregate_semi_global", "winner_take_all"])
def test_volumes(function):
    call = getattr(cvkern, function)
    options = (5, 20) if function == "aggregate_semi_global" else ()
    for wrong, rule in (
        (COSTS[0], "3-D, got shape (5, 6)"),
        (np.zeros((4, 0, 6), np.uint8), "not be empty, got shape (4, 0, 6)"),
    ):
        rule = f"costs must {'' if rule.startswith('not') else 'be '}{rule}"
        refused(ValueError, rule, call, wrong, *options)
    large = np.broadcast_to(np.uint8(0), (2048, 2048, 512))
    message = "costs must have at most 2147483647 elements, got shape (2048, 2048, 512)"
    refused(ValueError, message, call, large, *options)
    deep = np.broadcast_to(np.uint8(0), (1, 1, 32769))
    message = "costs must have at most 32768 disparities, got 32769"
    refused(ValueError, message, call, deep, *options)
    message = "costs must hold real numbers, got dtype complex128"
    refused(TypeError, message, call, COSTS.astype(complex), *options)


def test_costs_of_paths():
    for dtype in ("float32", "int16", "uint32", "bool"):
        message = f"costs must be uint8 or uint16, got {dtype}"
        sums_refused(TypeError, message, COSTS.astype(dtype))


def test_penalties():
    sums_refused(ValueError, "p1 must be in [0, 16384], got -1", p1=-1)
    sums_refused(ValueError, "p2 must be in [0, 16384], got -20", p2=-20)
    sums_refused(ValueError, "p1 must be <= p2, got 21 > 20", p1=21)
    sums_refused(TypeError, "p1 must be an integer, got 5.5", p1=5.5)
    sums_refused(TypeError, "p2 must be an integer, got None", p2=None)
    for wrong in (0, -3):
        sums_refused(ValueError, f"contrast must be > 0, got {wrong}", contrast=wrong)
    sums_refused(ValueError, "contrast must be finite, got nan", contrast=float("nan"))


def test_sums_of_paths():
    message = "paths * (largest_cost + p2) must be < 65536, got "
    sums_refused(ValueError, message + "8 * (255 + 7937) = 65536", p2=7937)
    sums_refused(ValueError, message + "16 * (255 + 3841) = 65536", p2=3841, paths=16)
    wide = COSTS.astype(np.uint16)
    sums_refused(
        ValueError, message + "4 * (16364 + 20) = 65536", wide, paths=4, largest_cost=16364
    )
    for wrong, dtype, most in ((256, np.uint8, 255), (-1, np.uint16, 65535)):
        message = f"largest_cost must be in [0, {most}], got {wrong}"
        sums_refused(ValueError, message, COSTS.astype(dtype), largest_cost=wrong)


def test_paths_and_guides():
    for wrong in (3, 5, "8", None):
        sums_refused(ValueError, f"paths must be one of (4, 8, 16), got {wrong!r}", paths=wrong)
    guide = np.zeros((4, 5), np.uint8)
    sums_refused(ValueError, "guide must have shape (4, 5), got (5, 4)", guide=guide.T)
    sums_refused(ValueError, "guide must be 2-D, got shape (4, 5, 6)", guide=COSTS)
    sums_refused(TypeError, "guide must be uint8, got float32", guide=guide.astype(np.float32))


def test_memory_of_sums():
    tall = np.broadcast_to(np.uint8(0), (400, 50, 32))
    need = 2 * tall.size + 2 * 6 * (64 + 2 * 64 + 50) * 64
    message = f"max_bytes must be at least {need} for costs of shape (400, 50, 32), got {need - 1}"
    sums_refused(ValueError, message, tall, max_bytes=need - 1)
    sums_refused(TypeError, "max_bytes must be an integer, got 1000000.0", max_bytes=1e6)


def test_options_of_winners():
    for options, error, message in (
        (
            {"first": 2**24 + 1},
            ValueError,
            f"first must be in [-{2**24}, {2**24}], got {2**24 + 1}",
        ),
        ({"first": 0.5}, TypeError, "first must be an integer, got 0.5"),
        ({"uniqueness": 100}, ValueError, "uniqueness must be in [0, 99], got 100"),
        (
            {"subpixel": "cubic"},
            ValueError,
            "subpixel must be one of ('parabola', 'equiangular'), got 'cubic'",
        ),
    ):
        refused(error, message, cvkern.winner_take_all, COSTS, **options)


# --- stereo matching and refinement --------------------------------------------------------------

PAIR: Any = np.zeros((4, 30), np.uint8)


def match_refused(error, message, left=PAIR, right=PAIR, disparities=(0, 8), **options):
    refused(error, message, cvkern.stereo_match, left, right, disparities, **options)


def test_pairs_to_match():
    for wrong in (np.zeros((4, 31)), np.zeros((30, 4)), np.zeros((4, 30, 3))):
        message = f"right must have the shape of left, (4, 30), got {wrong.shape}"
        match_refused(ValueError, message, right=wrong)
    match_refused(ValueError, "left must be 2-D or 3-D, got shape (4,)", left=PAIR[:, 0])
    match_refused(ValueError, "right must not be empty, got shape (0, 30)", right=PAIR[:0])
    message = "right must hold real numbers, got dtype complex128"
    match_refused(TypeError, message, right=PAIR.astype(complex))
    message = "channel_axis must be given for 3-D images and for no others, got None for shape "
    deep = np.zeros((4, 30, 2))
    match_refused(ValueError, f"{message}(4, 30, 2)", deep, deep)
    match_refused(
        ValueError, "channel_axis must have 3 or 4 channels, got 2", deep, deep, channel_axis=2
    )


def test_ranges_of_disparities():
    for ends, message in (
        ((8, 8), "disparities must be (first, stop) with first < stop, got (8, 8)"),
        ((0, 31), "disparities must be less than the width of 30 pixels, got (0, 31)"),
        ((-30, 0), "disparities must be less than the width of 30 pixels, got (-30, 0)"),
    ):
        match_refused(ValueError, message, disparities=ends)
    large = np.broadcast_to(np.uint8(0), (4000, 5000))
    message = "disparities must make at most 2147483647 costs, got "
    size = f"4000 x 5000 x 120 of {2 * 4000 * 5000 * 120} bytes"
    match_refused(ValueError, message + size, large, large, (0, 120))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "best"}, "method must be one of ('semi-global', 'window'), got 'best'"),
        ({"paths": 5}, "paths must be one of (4, 8, 16), got 5"),
        ({"window": 4}, "window must be odd, got 4"),
        ({"window": 53}, "window must be in [1, 51], got 53"),
        ({"data_range": 0}, "data_range must be > 0, got 0"),
        ({"p1": -1}, "p1 must be in [0, 16384], got -1"),
        ({"p2": -1}, "p2 must be in [0, 16384], got -1"),
        ({"p1": 30, "p2": 20}, "p1 must be <= p2, got 30 > 20"),
        (
            {"p2": 8138},
            "paths * (largest_cost + p2) must be < 65536, got 8 * (54 + 8138) = 65536",
        ),
        ({"contrast": 0}, "contrast must be > 0, got 0"),
        ({"uniqueness": 100}, "uniqueness must be in [0, 99], got 100"),
        ({"left_right": -1}, "left_right must be >= 0 and finite, got -1"),
        ({"speckle_size": -1}, "speckle_size must be in [0, 2147483647], got -1"),
        ({"speckle_difference": -1}, "speckle_difference must be >= 0 and finite, got -1"),
        ({"smoothing": 16}, "smoothing must be in [0, 15], got 16"),
        ({"smoothing": -1}, "smoothing must be in [0, 15], got -1"),
    ],
)
def test_options_of_matching(options, message):
    match_refused(ValueError, message, **options)
    refused(ValueError, message, cvkern.StereoMatcher, PAIR.shape, (0, 8), **options)


def test_refinement():
    maps = {
        "left_right_check": lambda x: cvkern.left_right_check(x, FLAT),
        "remove_speckles": cvkern.remove_speckles,
        "fill_disparity": cvkern.fill_disparity,
        "guided_median": lambda x: cvkern.guided_median(x, FLAT.astype(np.uint8)),
    }
    for call in maps.values():
        refused(ValueError, "disparity must be 2-D, got shape (4, 5, 3)", call, DEEP)
        refused(ValueError, "disparity must not be empty, got shape (0, 5)", call, FLAT[:0])
        message = "disparity must hold real numbers, got dtype complex128"
        refused(TypeError, message, call, FLAT.astype(complex))
    check, speckles, median = (
        cvkern.left_right_check,
        cvkern.remove_speckles,
        cvkern.guided_median,
    )
    guide = FLAT.astype(np.uint8)
    for call, message in (
        (lambda: check(FLAT, FLAT[1:]), "right must have shape (4, 5), got (3, 5)"),
        (lambda: check(FLAT, FLAT, tolerance=-1), "tolerance must be >= 0 and finite, got -1"),
        (lambda: speckles(FLAT, 0), "min_size must be in [1, 2147483647], got 0"),
        (lambda: speckles(FLAT, difference=-1), "difference must be >= 0 and finite, got -1"),
        (lambda: median(FLAT, guide[1:]), "guide must have shape (4, 5), got (3, 5)"),
        (lambda: median(FLAT, guide, 16), "radius must be in [0, 15], got 16"),
        (lambda: median(FLAT, guide, contrast=0), "contrast must be in [1, 65536], got 0"),
    ):
        refused(ValueError, message, call)
    refused(TypeError, "guide must be uint8, got float64", median, FLAT, FLAT)
