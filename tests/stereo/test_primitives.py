"""The primitives of stereo against NumPy: costs, semi-global matching, refinement."""

from typing import Any

import numpy as np
import pytest

from cvkern.kernels.codes.stereo import (
    CENSUS_BITS,
    Cost,
    Penalties,
    Rule,
    Subpixel,
    View,
    Winners,
)
from tests.primitives import F32, I32, U8, U16, U64, noise
from tests.stereo import reference_costs as stereo_reference
from tests.stereo import reference_paths as semi_global_reference
from tests.stereo import reference_refinement as disparity_reference

# ------------------------------------------------------------------------------- stereo costs


def stereo_pair(shape: tuple[int, ...], dtype: Any) -> Any:
    """Two noisy views of a texture, two pixels apart."""
    rng = np.random.default_rng(0)
    left = rng.integers(0, 256, shape)
    right = (np.roll(left, -2, 1) + rng.integers(-9, 10, left.shape)).clip(0, 255)
    if dtype == F32:
        left, right = left + rng.random(left.shape), right + rng.random(left.shape)
    return left.astype(dtype), right.astype(dtype)


def winners_of(shape):
    """What a primitive that picks winners fills."""
    return Winners((shape, I32), (shape, F32), (shape, F32), (shape, F32))


PAIRS = [(1, 1, 1), (1, 70, 2), (19, 1, 1), (40, 66, 3)]
WINDOWED = [(0, 1, (0, 0)), (-5, 33, (10, 2)), (3, 140, (1, 10))]  # first, count, radii


@pytest.mark.parametrize("symmetric", [False, True])
@pytest.mark.parametrize("dtype", [U8, F32])
@pytest.mark.parametrize("shape", PAIRS)
def test_census(kernels, shape, dtype, symmetric):
    image, _ = stereo_pair(shape, dtype)
    for radii, spacing in (((2, 2), 1), ((3, 4), 1), ((2, 2), 2), ((0, 32), 1), ((1, 0), 5)):
        if symmetric and radii == (1, 0):
            continue
        got = kernels(
            "stereo.costs.census.census", image, *radii, spacing, symmetric, out=[(shape, U64)]
        )
        bits = stereo_reference.census(image, *radii, spacing, symmetric)
        weights = np.uint64(1) << np.arange(bits.shape[-1], dtype=U64)
        np.testing.assert_array_equal(got, (bits * weights).sum(-1, dtype=U64))


@pytest.mark.parametrize(("first", "count"), [(0, 1), (-5, 33), (3, 140)])
@pytest.mark.parametrize("shape", PAIRS)
def test_hamming(kernels, shape, first, count):
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 2**63, (2, *shape)).astype(U64) * U64(2) + U64(1)
    got = kernels(
        "stereo.costs.census.hamming", left, right, first, out=[((*shape[:2], count), U8)]
    )
    partner = (np.arange(shape[1])[:, None] - first - np.arange(count)).clip(0, shape[1] - 1)
    want = np.bitwise_count(left[:, :, None] ^ right[:, partner]).sum(-1)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize(("first", "count", "radii"), WINDOWED)
@pytest.mark.parametrize("cost", [Cost.SAD, Cost.SSD, Cost.BIRCHFIELD_TOMASI, Cost.CENSUS])
@pytest.mark.parametrize("shape", PAIRS)
def test_window_costs_of_integers(kernels, shape, cost, first, count, radii):
    left, right = stereo_pair(shape, U8)
    octets = 1
    if cost == Cost.CENSUS:  # words with bits in the low three bytes only
        left, right = (np.repeat(i, 8, 2).view(U64) & U64(0xFFFFFF) for i in (left, right))
        octets = 3
    ends = first, first + count
    if cost == Cost.CENSUS:
        bits = [np.unpackbits(i.view(U8), axis=2).astype(U8) for i in (left, right)]
        want = stereo_reference.stereo_cost(*bits, ends, "sad", radii)
    else:
        want = stereo_reference.stereo_cost(left, right, ends, cost.name.lower(), radii)
    for dtype, most in ((U8, 2**8), (U16, 2**16), (F32, 2**31)):
        if want.max() < most:
            given = left, right, first, cost, octets, *radii
            got = kernels("stereo.costs.windows.window_costs", *given, out=[(want.shape, dtype)])
            np.testing.assert_array_equal(got, want.astype(dtype))


@pytest.mark.parametrize("radii", [(0, 0), (10, 2)])
@pytest.mark.parametrize("cost", [Cost.SAD, Cost.SSD, Cost.BIRCHFIELD_TOMASI])
@pytest.mark.parametrize("shape", PAIRS)
def test_window_costs_of_floats(kernels, shape, cost, radii):
    left, right = stereo_pair(shape, F32)
    out = [((*shape[:2], 37), F32)]
    got = kernels("stereo.costs.windows.window_costs", left, right, -2, cost, 1, *radii, out=out)
    want = stereo_reference.stereo_cost(left, right, (-2, 35), cost.name.lower(), radii)
    # The bound of test_costs.py: n terms below 257, or that squared.
    terms = shape[2] * (2 * radii[0] + 1) * (2 * radii[1] + 1)
    largest = 257.0 ** (2 if cost == Cost.SSD else 1)
    assert np.abs(got - want).max() <= 2 * terms * (terms + 3) * largest * 2**-24


@pytest.mark.parametrize("dtype", [U8, F32])
@pytest.mark.parametrize("radii", [(1, 1), (0, 3), (7, 2)])
@pytest.mark.parametrize("shape", PAIRS)
def test_correlation(kernels, shape, radii, dtype):
    left, right = stereo_pair(shape, dtype)
    out = [((*shape[:2], 37), F32)]
    got = kernels("stereo.costs.correlation.correlation", left, right, -2, *radii, out=out)
    want = stereo_reference.stereo_cost(left, right, (-2, 35), "zncc", radii)
    np.testing.assert_allclose(got, want, rtol=0, atol=2.0**-23)  # rounded once, from float64


@pytest.mark.parametrize(("first", "count", "radii"), WINDOWED)
@pytest.mark.parametrize("cost", [Cost.SAD, Cost.BIRCHFIELD_TOMASI, Cost.CENSUS])
@pytest.mark.parametrize("shape", PAIRS)
def test_match_windows(kernels, shape, cost, first, count, radii):
    """What `pick` and `pick_right` find among the costs of windows."""
    left, right = (image // 16 for image in stereo_pair(shape, U8))
    octets = 1
    if cost == Cost.CENSUS:
        left, right = (np.repeat(i, 8, 2).view(U64) & U64(0xFFFFFF) for i in (left, right))
        octets = 3
    rule, size = Rule(first, Subpixel.PARABOLA, 20), shape[:2]
    given = left, right, count, cost, octets, *radii, rule
    out = [winners_of(size), (size, I32)]
    got = kernels("stereo.windows.match_windows", *given, out=out)
    volume = [((*size, count), U16)]
    costs = kernels(
        "stereo.costs.windows.window_costs", left, right, first, cost, octets, *radii, out=volume
    )
    want = kernels("stereo.winners.pick", costs, rule, out=out[:1])
    right_want = kernels("stereo.winners.pick_right", costs, first, out=out[1:])
    for a, b in zip(got, [*want, right_want], strict=True):
        np.testing.assert_array_equal(a, b)


# ----------------------------------------------------------------------- semi-global matching


@pytest.mark.parametrize("paths", [4, 8, 16])
@pytest.mark.parametrize(
    ("dtype", "most", "p2_max"), [(U8, 255, 90), (U8, 255, 400), (U16, 1500, 200), (U16, 900, 900)]
)
@pytest.mark.parametrize("shape", [(1, 1, 1), (6, 9, 16), (9, 5, 45), (4, 19, 130), (2, 3, 600)])
def test_aggregate(kernels, shape, dtype, most, p2_max, paths):
    """By one byte a path and two, with disparities that fill their lanes and that do not."""
    rng = np.random.default_rng(0)
    costs = rng.integers(0, most + 1, shape).astype(dtype)
    p2 = rng.integers(30, p2_max + 1, 256).astype(U16)
    p2[7] = p2_max
    for guide in (rng.integers(0, 256, shape[:2]).astype(U8), np.zeros((1, 1), U8)):
        seen = guide if guide.shape == shape[:2] else None
        want = semi_global_reference.aggregate(costs, seen, 30, p2, paths)
        for top, rows in ((0, shape[0]), (shape[0] // 3, (shape[0] + 1) // 2)):
            given = costs, guide, Penalties(30, p2, p2_max), paths, top
            got = kernels(
                "stereo.paths.aggregation.aggregate", *given, out=[((rows, *shape[1:]), U16)]
            )
            np.testing.assert_array_equal(got, want[top : top + rows])


@pytest.mark.parametrize("first", [-3, 0, 40])
@pytest.mark.parametrize("shape", [(1, 1, 1), (7, 11, 16), (3, 70, 37), (2, 5, 300)])
def test_match_costs(kernels, shape, first):
    rng = np.random.default_rng(1)
    bits = rng.integers(0, 1 << CENSUS_BITS, (2, *shape[:2])).astype(U64)
    grey = rng.integers(0, 256, (2, *shape[:2])).astype(U8)
    views = [View(*view) for view in zip(bits, grey, strict=True)]
    got = kernels("stereo.paths.matching.match_costs", *views, first, out=[(shape, U8)])
    for k in range(shape[2]):
        there = np.clip(np.arange(shape[1]) - first - k, 0, shape[1] - 1)
        differ = (bits[0] ^ bits[1][:, there])[..., None].view(U8)
        count = np.unpackbits(differ, axis=-1).sum(-1)
        grey_difference = np.abs(grey[0].astype(int) - grey[1][:, there]) // 2
        np.testing.assert_array_equal(got[..., k], 2 * count + np.minimum(grey_difference, 6))


@pytest.mark.parametrize(("paths", "p2_max"), [(4, 80), (8, 80), (8, 300), (16, 80)])
@pytest.mark.parametrize(
    ("shape", "first"),
    [((1, 1, 1), 0), ((6, 40, 16), -5), ((5, 33, 45), 3), ((4, 70, 100), 2), ((3, 9, 130), 0)],
)
def test_match_is_its_steps_in_one(kernels, shape, first, paths, p2_max):
    rng = np.random.default_rng(2)
    bits = rng.integers(0, 1 << CENSUS_BITS, (2, *shape[:2])).astype(U64)
    grey = rng.integers(0, 256, (2, *shape[:2])).astype(U8)
    p2 = np.linspace(p2_max, 20, 256).astype(U16)
    top = shape[0] // 3
    size = (shape[0] + 1) // 2, shape[1]
    views = [View(*view) for view in zip(bits, grey, strict=True)]
    costs = kernels("stereo.paths.matching.match_costs", *views, first, out=[(shape, U8)])
    sums = semi_global_reference.aggregate(costs, grey[0], 20, p2, paths)
    sums = sums[top : top + size[0]].astype(U16)
    out = [winners_of(size), (size, I32)]
    for subpixel, uniqueness in ((Subpixel.PARABOLA, 0), (Subpixel.NONE, 20)):
        rule = Rule(first, subpixel, uniqueness)
        given = *views, shape[2], Penalties(20, p2, p2_max), paths, rule, top
        got = kernels("stereo.paths.matching.match", *given, out=out)
        want = kernels("stereo.winners.pick", sums, rule, out=out[:1])
        right = kernels("stereo.winners.pick_right", sums, first, out=out[1:])
        np.testing.assert_array_equal(right, semi_global_reference.pick_right(sums, first))
        for a, b in zip(got, [*want, right], strict=True):
            np.testing.assert_array_equal(a, b)


# ------------------------------------------------------------------- refinement of disparities


def rough(*shape, seed=0):
    """Disparities in pieces, with steps of half a pixel, gaps and empty rows."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] // 6
    values = rng.integers(0, 9, (y.max() + 1, x.max() + 1))[y, x] + rng.integers(0, 3, shape) / 2
    values[rng.random(shape) < 0.2] = np.nan
    values[: shape[0] // 5] = np.nan
    return values.astype(F32)


@pytest.mark.parametrize("shape", [(1, 1), (1, 65), (40, 1), (23, 61), (5, 128), (97, 131)])
def test_refinement(kernels, shape):
    disparity, guide = rough(*shape), np.random.default_rng(1).integers(0, 256, shape, U8)
    out = [(shape, F32)]
    right = rough(*shape, seed=1)
    got = kernels("stereo.refinement.agreement.left_right", disparity, right, 0, 0.75, out=out)
    np.testing.assert_array_equal(got, disparity_reference.left_right(disparity, right, 0.75))
    index = np.random.default_rng(2).integers(-1, 9, shape).astype(I32)
    got = kernels("stereo.refinement.agreement.left_right", disparity, index, -2, 1.0, out=out)
    other = np.where(index < 0, np.nan, index - 2)
    np.testing.assert_array_equal(got, disparity_reference.left_right(disparity, other, 1.0))
    for size in (1, 9, 300):
        got = kernels("stereo.refinement.speckles.remove_speckles", disparity, size, 0.5, out=out)
        want = disparity_reference.remove_speckles(disparity, size, 0.5)
        np.testing.assert_array_equal(got, want)
    filled, valid = kernels("stereo.refinement.gaps.fill", disparity, out=[*out, (shape, U8)])
    want = disparity_reference.fill(disparity)
    np.testing.assert_array_equal(filled, want[0])
    np.testing.assert_array_equal(valid, want[1])
    for radius, contrast in ((0, 40), (2, 1), (6, 40), (15, 300)):
        got = kernels(
            "stereo.refinement.medians.guided_median", disparity, guide, radius, contrast, out=out
        )
        want = disparity_reference.guided_median(disparity, guide, radius, contrast)
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_gray_bytes(kernels, channels):
    shape = 31, 45
    octets = np.random.default_rng(3).integers(0, 256, (*shape, channels), U8)
    numbers = noise(*shape, channels) * 90 + 120  # some below 0, some above 255
    numbers[0, :3] = np.array([np.nan, np.inf, -np.inf])[:, None]
    for image, scale in ((octets, 1.0), (numbers, 1.0), (numbers, F32(0.37))):
        got = kernels("stereo.costs.gray.gray_bytes", image, float(scale), out=[(shape, U8)])
        np.testing.assert_array_equal(got, disparity_reference.gray_bytes(image, scale))
