"""Every primitive of every kernel set against an oracle, and the sets against each other.

Kernels do float32 arithmetic in a stated order, so NumPy doing the same must give the same bits.
"""

from typing import Any

import numpy as np
import pytest
import scipy.ndimage as ndi
from reference import disparity as disparity_reference
from reference import edges as edges_reference
from reference import filters as filters_reference
from reference import gradients as gradients_reference
from reference import lines as lines_reference
from reference import rank as rank_reference
from reference import semi_global as semi_global_reference
from reference import stereo_cost as stereo_reference

from cvkern._line_votes import direction_windows, line_tables
from cvkern.kernels.codes import (
    CENSUS_BITS,
    DIRECTION_FACTOR,
    DIRECTIONS,
    SCALE_ONE,
    TILE,
    TURN_ONE,
    VECTOR_ONE,
    Border,
    Cost,
    Edge,
    Norm,
    Subpixel,
    Thinning,
)

F32, I32, U8, U16, U64 = np.float32, np.int32, np.uint8, np.uint16, np.uint64


def noise(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(F32)


def waves(height, width, seed=0):
    """Smooth gradients in every direction, with flat parts and ties."""
    values = ndi.gaussian_filter(noise(height, width, seed=seed).astype(float), 2.0) * 50
    values[: height // 4] = 0
    values[:, : width // 5] = np.round(values[:, : width // 5])
    dy, dx = np.gradient(values) if min(values.shape) > 1 else (values, -values)
    return np.asarray(dy, F32), np.asarray(dx, F32)


# ------------------------------------------------------------------- filters, gradients, ranks

SEPARABLE = [
    # shape (P, H, W), step, radii (rows, columns)
    ((1, 1, 1), 1, (1, 2)),
    ((1, 1, 9), 1, (3, 1)),
    ((1, 7, 1), 1, (1, 9)),
    ((2, 5, 6), 3, (7, 8)),
    ((1, 33, 41), 1, (2, 0)),
    ((3, 17, 70), 2, (4, 4)),
]


@pytest.mark.parametrize("border", Border)
@pytest.mark.parametrize(("shape", "step", "radii"), SEPARABLE)
def test_correlate_separable(kernels, shape, step, radii, border):
    src = noise(*shape[:2], shape[2] * step)
    taps_y, taps_x = (noise(2 * r + 1, seed=r + 1) for r in radii)
    options = step, border, 0.3
    got = kernels(
        "filters.correlate_separable", src, taps_y, taps_x, *options, out=[(src.shape, F32)]
    )

    planes = src.astype(float).reshape(*shape, step)
    mode = border.name.lower()
    want = ndi.correlate1d(planes, taps_y.astype(float), 1, mode=mode, cval=0.3)
    want = ndi.correlate1d(want, taps_x.astype(float), 2, mode=mode, cval=0.3)
    # Every product and sum is rounded: at most (taps + 1) 2^-24 of the sum of their sizes.
    size = (np.abs(taps_y).sum() * np.abs(taps_x).sum()) * max(1, np.abs(src).max())
    assert np.abs(got - want.reshape(src.shape)).max() <= 2 * (sum(radii) + 4) * 2**-23 * size

    bits = filters_reference.correlate_separable(src, taps_y, taps_x, *options)
    np.testing.assert_array_equal(got, bits)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (37, 29), (20, 130)])
def test_differentiate_polar(kernels, shape):
    src = np.round(noise(*shape) * 2)  # with flat parts, where derivatives are 0
    taps = np.array([1, 2, 1], F32), np.array([-1, 0, 1], F32)
    dy, dx, magnitude, orientation = kernels(
        "gradients.differentiate_polar", src, *taps, Border.NEAREST, 0.0, 0.0, 0.0,
        out=[(shape, F32)] * 4,
    )  # fmt: skip
    down = ndi.correlate1d(src, taps[1], 0, mode="nearest")
    np.testing.assert_array_equal(dy, ndi.correlate1d(down, taps[0], 1, mode="nearest"))
    np.testing.assert_array_equal(magnitude, np.sqrt(dx * dx + dy * dy))
    np.testing.assert_array_equal(orientation, gradients_reference.orientation(dy, dx))
    want = np.arctan2(dy.astype(float), dx.astype(float))
    # The fit is within 1.4e-7 of the arc tangent; the sums with pi round once more.
    np.testing.assert_allclose(orientation, want, atol=4e-7, rtol=0)


def test_orientation_at_the_axes(kernels):
    # From the middle of a cross on, every derivative is a multiple of the two arms.
    for dy, dx, turns in [
        (0, 1, 0),
        (1, 0, 1),
        (0, -1, 2),
        (-1, 0, -1),
        (2, 2, 0.5),
        (-2, -2, -1.5),
    ]:
        src = np.zeros((3, 3), F32)
        src[1, 2], src[2, 1] = dx, dy
        *_, orientation = kernels(
            "gradients.differentiate_polar", src, np.array([0, 1, 0], F32),
            np.array([-1, 0, 1], F32), Border.NEAREST, 0.0, 0.0, 0.0, out=[(src.shape, F32)] * 4,
        )  # fmt: skip
        np.testing.assert_allclose(orientation[1, 1], turns * np.pi / 2, atol=5e-7)


MEDIAN = [
    # dtype of the values, low, bits
    (np.uint8, 0, 8),
    (np.int16, -(2**15), 16),
    (np.int32, -(2**31), 32),
]


@pytest.mark.parametrize("border", Border)
@pytest.mark.parametrize(("dtype", "low", "bits"), MEDIAN)
@pytest.mark.parametrize(
    ("shape", "step", "radius"),
    [((1, 1, 1), 1, 1), ((1, 9, 1), 1, 2), ((1, 12, 37), 1, 1), ((2, 11, 8), 3, 7)],
)
def test_median(kernels, shape, step, radius, dtype, low, bits, border):
    info = np.iinfo(dtype)
    shape = (*shape[:2], shape[2] * step)
    src = np.random.default_rng(1).integers(info.min, info.max, shape, I32, endpoint=True)
    src[0, 0, 0], src[-1, -1, -1] = info.min, info.max
    cval = 99
    given = radius, step, low, bits, border, cval
    got = kernels("rank.median", src, *given, out=[(shape, I32)])
    np.testing.assert_array_equal(got, rank_reference.median(src, radius, step, border, cval))


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (1, 37, 29)])
def test_root_mean_square(kernels, shape):
    dy, dx = noise(*shape), noise(*shape, seed=1)
    got = kernels("gradients.root_mean_square", dy, dx, out=[(shape, F32)])
    np.testing.assert_array_equal(got, np.sqrt((dx * dx + dy * dy) * F32(0.5)))
    np.testing.assert_allclose(got, np.hypot(dy, dx, dtype=float) / np.sqrt(2), rtol=2e-7)


def test_keys_order_floats(kernels):
    values = np.concatenate([noise(500) * 1e3, noise(500) * 1e-3, [0.0, np.inf, -np.inf]])
    values = values.astype(F32).reshape(1, 17, 59)
    keys = kernels("rank.keys_of_floats", values.view(I32), out=[(values.shape, I32)])
    order = np.argsort(values, axis=None, kind="stable")
    np.testing.assert_array_equal(np.argsort(keys, axis=None, kind="stable"), order)
    back = kernels("rank.floats_of_keys", keys, out=[(values.shape, I32)])
    np.testing.assert_array_equal(back.view(F32), values)


def test_nan_of_either_sign_is_above_infinity(kernels):
    values = np.array([-np.nan, np.nan, np.inf, -1], F32)
    keys = kernels("rank.keys_of_floats", values.view(I32), out=[(values.shape, I32)])
    assert keys[0] == keys[1] > keys[2] > 0 > keys[3]
    assert np.isnan(
        kernels("rank.floats_of_keys", keys, out=[(keys.shape, I32)]).view(F32)[:2]
    ).all()


@pytest.mark.parametrize("border", Border)
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (9, 3), (37, 70)])
def test_differentiate(kernels, shape, border):
    src, smooth, slope = noise(*shape), noise(7, seed=1), noise(7, seed=2)
    beside = F32(0.6), F32(-0.2)
    got = kernels(
        "gradients.differentiate", src, smooth, slope, border, 0.3, *map(float, beside),
        out=[(shape, F32)] * 2,
    )  # fmt: skip
    for result, (down, along), cval in zip(
        got, ((slope, smooth), (smooth, slope)), beside[::-1], strict=True
    ):
        middle = filters_reference.correlate(src, down, 0, border, F32(0.3))
        want = filters_reference.correlate(middle, along, 1, border, cval)
        np.testing.assert_array_equal(result, want)


# ------------------------------------------------------------------------------------ edges


@pytest.mark.parametrize("rule", Thinning)
@pytest.mark.parametrize("norm", Norm)
@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (2, 2), (41, 57)])
def test_thin(kernels, shape, norm, rule):
    for dy, dx in (waves(*shape), (noise(*shape), noise(*shape, seed=1))):
        square = norm == Norm.L2
        low, high = (0.25, 1.0) if square else (0.5, 1.3)
        got = kernels("edges.thin", dy, dx, norm, rule, low, high, out=[(shape, U8)])
        want = edges_reference.thin(dy, dx, norm, rule, low, high)
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("l2", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (40, 1), (48, 65)])
def test_thin_sobel_and_hysteresis_are_canny(kernels, shape, l2):
    cv2 = pytest.importorskip("cv2")
    image = np.random.default_rng(5).integers(0, 256, shape, U8, endpoint=False)
    smooth = ndi.uniform_filter(image, 3)
    for src in (image, smooth):
        low, high = 60, 150
        limits = (float(low**2), float(high**2)) if l2 else (float(low), float(high))
        norm = Norm.L2 if l2 else Norm.L1
        given = Border.NEAREST, 0.0, norm, *limits
        states = kernels("edges.thin_sobel", src, *given, out=[(shape, U8)])
        mask = kernels("edges.hysteresis", states, out=[(shape, U8)])
        want = cv2.Canny(src, low, high, L2gradient=l2) if min(shape) > 1 else None
        if want is not None:
            np.testing.assert_array_equal(mask * 255, want)


@pytest.mark.parametrize("border", Border)
def test_thin_sobel_differentiates_by_its_border(kernels, border):
    src = np.random.default_rng(6).integers(0, 256, (13, 18), U8, endpoint=False)
    mode = {"mode": border.name.lower(), "cval": 40.0}
    operator = np.outer([-1, 0, 1], [1, 2, 1])
    dy = ndi.correlate(src.astype(F32), operator, **mode)
    dx = ndi.correlate(src.astype(F32), operator.T, **mode)
    want = edges_reference.thin(dy, dx, Norm.L1, Thinning.SECTORS, 90.0, 300.0)
    given = border, 40.0, Norm.L1, 90.0, 300.0
    got = kernels("edges.thin_sobel", src, *given, out=[(src.shape, U8)])
    np.testing.assert_array_equal(got, want)


def spiral(size):
    """One weak line, a pixel wide, that winds from a strong corner to the middle."""
    states = np.zeros((size, size), U8)
    y, x, step = 0, 0, (0, 1)
    states[0, 0] = Edge.STRONG
    for length in [size - 1, *np.repeat(np.arange(size - 1, 1, -2), 2)]:
        for _ in range(length):
            y, x = y + step[0], x + step[1]
            states[y, x] = Edge.WEAK
        step = (step[1], -step[0])
    return states


@pytest.mark.parametrize("density", [0.1, 0.35, 0.6, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 64), (64, 1), (70, 90)])
def test_hysteresis(kernels, shape, density):
    rng = np.random.default_rng(7)
    states = np.where(rng.random(shape) < density, Edge.WEAK, Edge.NONE).astype(U8)
    states[(rng.random(shape) < 0.02) & (states > 0)] = Edge.STRONG
    got = kernels("edges.hysteresis", states, out=[(shape, U8)])
    np.testing.assert_array_equal(got, edges_reference.hysteresis(states))


@pytest.mark.parametrize("corner", [Edge.STRONG, Edge.WEAK])
def test_hysteresis_follows_a_long_line(kernels, corner):
    for states in (spiral(65), spiral(65)[::-1], spiral(65)[:, ::-1].T):
        states = np.where(states == Edge.STRONG, corner, states).astype(U8)
        got = kernels("edges.hysteresis", states, out=[(states.shape, U8)])
        np.testing.assert_array_equal(got, (states > 0) & (corner == Edge.STRONG))


@pytest.mark.parametrize("shape", [(1, 1), (1, 20), (20, 1), (45, 61)])
def test_subpixel_edges(kernels, shape):
    dy, dx = waves(*shape, seed=8)
    mask = (np.random.default_rng(8).random(shape) < 0.8).astype(U8)
    pixels, points, magnified = edges_reference.subpixel_edges(dy, dx, mask)
    counts = kernels("edges.count_edges", dy, dx, mask, out=[(shape[:1], I32)])
    np.testing.assert_array_equal(counts, np.bincount(pixels[:, 0], minlength=shape[0]))

    n = len(pixels)
    starts = (np.cumsum(counts) - counts).astype(I32)
    out = [((n, 2), F32), ((n,), F32), ((n,), F32)]
    got, orientation, strength = kernels("edges.gather_edges", dy, dx, mask, starts, out=out)
    # Each logarithm within two units in the last place, then the sum with the coordinate.
    error = np.abs(got - points).max(1, initial=0)
    assert np.all(error <= 2**-22 * magnified + 2**-24 * max(shape))
    y, x = pixels.T
    np.testing.assert_array_equal(strength, np.sqrt(dx[y, x] * dx[y, x] + dy[y, x] * dy[y, x]))
    np.testing.assert_array_equal(orientation, gradients_reference.orientation(dy[y, x], dx[y, x]))


# ---------------------------------------------------------------- shapes


def shape_votes(height, width):
    """Points sorted by direction, twice over, their starts; a table; rotations and scales."""
    rng = np.random.default_rng(3)
    count = 700
    codes = np.sort(rng.integers(0, DIRECTIONS, count))
    points = np.zeros((2, 2 * count + 16), I32)
    points[:, : 2 * count] = np.tile(rng.integers(0, (height, width), (count, 2)).T, 2)
    numbers = np.bincount(codes, minlength=DIRECTIONS)
    starts = np.concatenate(([0], np.cumsum(np.tile(numbers, 2)))).astype(I32)
    vectors = rng.integers(-30 * VECTOR_ONE, 30 * VECTOR_ONE, (90, 2)).astype(I32)
    directions = rng.integers(0, DIRECTIONS, 90).astype(I32)
    turns = np.array([0, 4000, 16000])
    angles = turns * (2 * np.pi / DIRECTIONS)
    turns = np.stack((turns, TURN_ONE * np.cos(angles), TURN_ONE * np.sin(angles)), 1).round()
    scales = np.array([0.8, 1.3]) * SCALE_ONE
    return points, starts, vectors, directions, turns.astype(I32), scales.astype(I32)


@pytest.mark.parametrize("shift", [0, 3])
def test_accumulate_and_search(kernels, shift):
    """The integers that the kernels state, pair by pair."""
    height, width, tolerance = 53, 67, 60
    given = shape_votes(height, width)
    points, starts, vectors, directions, turns, scales = (a.astype(np.int64) for a in given)
    cells = ((height - 1) >> shift) + 1, ((width - 1) >> shift) + 1
    want = np.zeros((3, 2, *cells), np.int64)
    for r, (turn, cosine, sine) in enumerate(turns):
        for (y, x), direction in zip(vectors, directions, strict=True):
            low = (direction + turn - tolerance) % DIRECTIONS
            some = points[:, starts[low] : starts[low + 2 * tolerance + 1]]
            turned = np.array([y * cosine + x * sine, x * cosine - y * sine])
            turned = np.floor(turned / 2**24 + 0.5).astype(np.int64)
            for s, scale in enumerate(scales):
                at = some + np.floor(turned * scale / 2**15 + 0.5).astype(np.int64)[:, None]
                at = at[:, (at >= 0).all(0) & (at[0] < height) & (at[1] < width)] >> shift
                np.add.at(want[r, s], tuple(at), 1)
    options = tolerance, height, width, shift
    got = kernels("shapes.accumulate", *given, *options, out=[(want.shape, I32)])
    np.testing.assert_array_equal(got, want)
    assert want.sum() > 500
    padded = np.pad(want, ((0, 0), (0, 0), (0, 1), (0, 1)))
    sums = padded[..., 1:, 1:] + padded[..., :-1, 1:] + padded[..., 1:, :-1] + padded[..., :-1, :-1]
    tiles = -(-cells[0] // TILE), -(-cells[1] // TILE)
    keys = kernels("shapes.search", *given, *options, out=[((3, 2, *tiles), I32)])
    for r, s, down, across in np.ndindex(*keys.shape):
        tile = sums[r, s, down * TILE : (down + 1) * TILE, across * TILE : (across + 1) * TILE]
        i, j = np.unravel_index(tile.argmax(), tile.shape)  # the first of equal ones
        place = TILE * TILE - 1 - (i * TILE + j)
        assert keys[r, s, down, across] == tile.max() * TILE * TILE + place


def test_code_directions(kernels):
    dy, dx = waves(31, 40)
    points = np.argwhere(dy > 0).astype(I32)
    got = kernels("shapes.code_directions", points, dy, dx, out=[((len(points),), I32)])
    angles = gradients_reference.orientation(dy, dx)[tuple(points.T)]
    turned = np.floor(angles * F32(DIRECTION_FACTOR) + F32(0.5)).astype(I32)
    np.testing.assert_array_equal(got, turned % DIRECTIONS)


# ------------------------------------------------------------------------------- stereo costs


def stereo_pair(shape: tuple[int, ...], dtype: Any) -> Any:
    """Two noisy views of a texture, two pixels apart."""
    rng = np.random.default_rng(0)
    left = rng.integers(0, 256, shape)
    right = (np.roll(left, -2, 1) + rng.integers(-9, 10, left.shape)).clip(0, 255)
    if dtype == F32:
        left, right = left + rng.random(left.shape), right + rng.random(left.shape)
    return left.astype(dtype), right.astype(dtype)


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
        got = kernels("stereo_cost.census", image, *radii, spacing, symmetric, out=[(shape, U64)])
        bits = stereo_reference.census(image, *radii, spacing, symmetric)
        weights = np.uint64(1) << np.arange(bits.shape[-1], dtype=U64)
        np.testing.assert_array_equal(got, (bits * weights).sum(-1, dtype=U64))


@pytest.mark.parametrize(("first", "count"), [(0, 1), (-5, 33), (3, 140)])
@pytest.mark.parametrize("shape", PAIRS)
def test_hamming(kernels, shape, first, count):
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 2**63, (2, *shape)).astype(U64) * U64(2) + U64(1)
    got = kernels("stereo_cost.hamming", left, right, first, out=[((*shape[:2], count), U8)])
    partner = (np.arange(shape[1])[:, None] - first - np.arange(count)).clip(0, shape[1] - 1)
    want = np.bitwise_count(left[:, :, None] ^ right[:, partner]).sum(-1)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize(("first", "count", "radii"), WINDOWED)
@pytest.mark.parametrize("cost", [Cost.SAD, Cost.SSD, Cost.BIRCHFIELD_TOMASI, Cost.CENSUS])
@pytest.mark.parametrize("shape", PAIRS)
def test_window_costs_of_integers(kernels, shape, cost, first, count, radii):
    left, right = stereo_pair(shape, U8)
    octets = 1
    if cost == Cost.CENSUS:  # of uint64 in whose low three bytes there are bits
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
            got = kernels("stereo_cost.window_costs", *given, out=[(want.shape, dtype)])
            np.testing.assert_array_equal(got, want.astype(dtype))


@pytest.mark.parametrize("radii", [(0, 0), (10, 2)])
@pytest.mark.parametrize("cost", [Cost.SAD, Cost.SSD, Cost.BIRCHFIELD_TOMASI])
@pytest.mark.parametrize("shape", PAIRS)
def test_window_costs_of_floats(kernels, shape, cost, radii):
    left, right = stereo_pair(shape, F32)
    out = [((*shape[:2], 37), F32)]
    got = kernels("stereo_cost.window_costs", left, right, -2, cost, 1, *radii, out=out)
    want = stereo_reference.stereo_cost(left, right, (-2, 35), cost.name.lower(), radii)
    # As in test_stereo_cost.py: n terms below 257, or that squared.
    terms = shape[2] * (2 * radii[0] + 1) * (2 * radii[1] + 1)
    largest = 257.0 ** (2 if cost == Cost.SSD else 1)
    assert np.abs(got - want).max() <= 2 * terms * (terms + 3) * largest * 2**-24


@pytest.mark.parametrize("dtype", [U8, F32])
@pytest.mark.parametrize("radii", [(1, 1), (0, 3), (7, 2)])
@pytest.mark.parametrize("shape", PAIRS)
def test_correlation(kernels, shape, radii, dtype):
    left, right = stereo_pair(shape, dtype)
    out = [((*shape[:2], 37), F32)]
    got = kernels("stereo_cost.correlation", left, right, -2, *radii, out=out)
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
    given = left, right, first, count, cost, octets, *radii, Subpixel.PARABOLA, 20
    size = shape[:2]
    out = [(size, I32), (size, F32), (size, F32), (size, F32), (size, I32)]
    got = kernels("window_matching.match_windows", *given, out=out)
    volume = [((*size, count), U16)]
    costs = kernels(
        "stereo_cost.window_costs", left, right, first, cost, octets, *radii, out=volume
    )
    want = kernels("semi_global.pick", costs, first, Subpixel.PARABOLA, 20, out=out[:4])
    right_want = kernels("semi_global.pick_right", costs, first, out=out[4:])
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
            given = costs, guide, 30, p2, p2_max, paths, top
            got = kernels("semi_global.aggregate", *given, out=[((rows, *shape[1:]), U16)])
            np.testing.assert_array_equal(got, want[top : top + rows])


@pytest.mark.parametrize("first", [-3, 0, 40])
@pytest.mark.parametrize("shape", [(1, 1, 1), (7, 11, 16), (3, 70, 37), (2, 5, 300)])
def test_match_costs(kernels, shape, first):
    rng = np.random.default_rng(1)
    bits = rng.integers(0, 1 << CENSUS_BITS, (2, *shape[:2])).astype(U64)
    grey = rng.integers(0, 256, (2, *shape[:2])).astype(U8)
    got = kernels("semi_global.match_costs", *bits, *grey, first, out=[(shape, U8)])
    for k in range(shape[2]):
        there = np.clip(np.arange(shape[1]) - first - k, 0, shape[1] - 1)
        differ = (bits[0] ^ bits[1][:, there])[..., None].view(U8)
        count = np.unpackbits(differ, axis=-1).sum(-1)
        grey_difference = np.abs(grey[0].astype(int) - grey[1][:, there]) // 2
        np.testing.assert_array_equal(got[..., k], 2 * count + np.minimum(grey_difference, 6))


@pytest.mark.parametrize(("paths", "p2_max"), [(4, 80), (8, 80), (8, 300), (16, 80)])
@pytest.mark.parametrize(
    ("shape", "first"), [((1, 1, 1), 0), ((6, 40, 16), -5), ((5, 33, 45), 3), ((3, 9, 130), 0)]
)
def test_match_is_its_steps_in_one(kernels, shape, first, paths, p2_max):
    rng = np.random.default_rng(2)
    bits = rng.integers(0, 1 << CENSUS_BITS, (2, *shape[:2])).astype(U64)
    grey = rng.integers(0, 256, (2, *shape[:2])).astype(U8)
    p2 = np.linspace(p2_max, 20, 256).astype(U16)
    top = shape[0] // 3
    size = (shape[0] + 1) // 2, shape[1]
    costs = kernels("semi_global.match_costs", *bits, *grey, first, out=[(shape, U8)])
    sums = semi_global_reference.aggregate(costs, grey[0], 20, p2, paths)
    sums = sums[top : top + size[0]].astype(U16)
    out = [(size, I32), (size, F32), (size, F32), (size, F32), (size, I32)]
    for subpixel, uniqueness in ((Subpixel.PARABOLA, 0), (Subpixel.NONE, 20)):
        given = first, shape[2], 20, p2, p2_max, paths, subpixel, uniqueness, top
        got = kernels("semi_global.match", *bits, *grey, *given, out=out)
        want = kernels("semi_global.pick", sums, first, subpixel, uniqueness, out=out[:4])
        right = kernels("semi_global.pick_right", sums, first, out=out[4:])
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


@pytest.mark.parametrize("shape", [(1, 1), (1, 65), (40, 1), (23, 61), (97, 131)])
def test_refinement(kernels, shape):
    disparity, guide = rough(*shape), np.random.default_rng(1).integers(0, 256, shape, U8)
    out = [(shape, F32)]
    right = rough(*shape, seed=1)
    got = kernels("disparity.left_right", disparity, right, 0, 0.75, out=out)
    np.testing.assert_array_equal(got, disparity_reference.left_right(disparity, right, 0.75))
    index = np.random.default_rng(2).integers(-1, 9, shape).astype(I32)
    got = kernels("disparity.left_right", disparity, index, -2, 1.0, out=out)
    other = np.where(index < 0, np.nan, index - 2)
    np.testing.assert_array_equal(got, disparity_reference.left_right(disparity, other, 1.0))
    for size in (1, 9, 300):
        got = kernels("disparity.remove_speckles", disparity, size, 0.5, out=out)
        want = disparity_reference.remove_speckles(disparity, size, 0.5)
        np.testing.assert_array_equal(got, want)
    filled, valid = kernels("disparity.fill", disparity, out=[*out, (shape, U8)])
    want = disparity_reference.fill(disparity)
    np.testing.assert_array_equal(filled, want[0])
    np.testing.assert_array_equal(valid, want[1])
    for radius, contrast in ((0, 40), (2, 1), (6, 40), (15, 300)):
        got = kernels("disparity.guided_median", disparity, guide, radius, contrast, out=out)
        want = disparity_reference.guided_median(disparity, guide, radius, contrast)
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_gray_bytes(kernels, channels):
    shape = 31, 45
    octets = np.random.default_rng(3).integers(0, 256, (*shape, channels), U8)
    numbers = noise(*shape, channels) * 90 + 120  # some below 0, some above 255
    numbers[0, :3] = np.array([np.nan, np.inf, -np.inf])[:, None]
    for image, scale in ((octets, 1.0), (numbers, 1.0), (numbers, F32(0.37))):
        got = kernels("stereo.gray_bytes", image, float(scale), out=[(shape, U8)])
        np.testing.assert_array_equal(got, disparity_reference.gray_bytes(image, scale))


# ---------------------------------------------------------------- the sets against each other


# ------------------------------------------------------------------- points and lines


def line_votes(angles, number=300, seed=3, size=(90, 130)):
    """Return what voting for lines takes: points, their count, and tables."""
    rng = np.random.default_rng(seed)
    mask = np.zeros(size, bool)
    mask.ravel()[rng.choice(mask.size, number, replace=False)] = True
    theta = np.sort(rng.uniform(-1.5, 1.5, angles))
    tables = line_tables(theta.tobytes(), 1.0, size, 1)
    counted = np.array([0, number], I32)
    spare = np.full((number + 5, 2), -9, I32)  # beyond the count there is anything
    spare[:number] = np.argwhere(mask)
    return mask, spare, counted, theta, tables


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (9, 64), (300, 217), (257, 48)])
def test_count_and_gather(kernels, shape):
    mask = (np.random.default_rng(1).random(shape) < 0.2) * U8(7)
    starts = kernels("points.count", mask, out=[((shape[0] + 1,), I32)])
    np.testing.assert_array_equal(starts, np.append(0, np.cumsum((mask > 0).sum(1))))
    want = np.argwhere(mask)
    points = kernels("points.gather", mask, starts, out=[((len(want) + 1, 2), I32)])
    np.testing.assert_array_equal(points[: len(want)], want)


def test_first_outside(kernels):
    mask, points, counted, _, _ = line_votes(3)
    values = noise(*mask.shape)
    for place in (300, 120, 7):
        if place < 300:
            values[tuple(points[place])] = np.nan
        (first,) = kernels("points.first_outside", points, counted, values, -9.0, 9.0,
                           out=[((1,), I32)])  # fmt: skip
        assert first == place


@pytest.mark.parametrize("angles", [1, 7, 8, 33])
@pytest.mark.parametrize("weighted", [False, True])
def test_votes_for_lines(kernels, angles, weighted):
    mask, points, counted, theta, tables = line_votes(angles)
    rows = 2 * int(np.ceil(np.hypot(*mask.shape))) + 1
    rng = np.random.default_rng(5)
    weights = rng.integers(0, 999, len(points)).astype(I32)
    cast = weights if weighted else np.ones_like(weights)
    given = *tables, weighted, weights
    got = kernels("lines.vote", points, counted, *given, out=[((rows, angles), I32)])
    want = lines_reference.vote(points[:300], tables, None, None, cast, rows, angles)
    np.testing.assert_array_equal(got, want)

    turned = rng.uniform(-4, 4, len(points)).astype(F32)
    windows = direction_windows(theta.tobytes(), 0.2)
    got = kernels(
        "lines.vote_directed", points, counted, turned, *windows, *given,
        out=[((rows, angles), I32)],
    )  # fmt: skip
    codes = lines_reference.half_turn_codes(turned)
    want = lines_reference.vote(points[:300], tables, windows, codes, cast, rows, angles)
    np.testing.assert_array_equal(got, want)


def test_votes_in_more_bins_than_a_block_holds(kernels):
    """On CUDA the histogram of an angle is then cut into parts."""
    size = (13000, 3)
    tables = line_tables(np.linspace(-1.5, 1.5, 5).tobytes(), 1.0, size, 1)
    points = np.stack([np.arange(0, 13000, 9), np.arange(0, 13000, 9) % 3], 1).astype(I32)
    counted = np.array([len(points)], I32)
    weights = np.ones(len(points), I32)
    got = kernels("lines.vote", points, counted, *tables, False, weights, out=[((26003, 5), I32)])
    want = lines_reference.vote(points, tables, None, None, weights, 26003, 5)
    np.testing.assert_array_equal(got, want)


def test_take(kernels):
    mask, points, counted, _, _ = line_votes(3)
    values = noise(*mask.shape)
    got = kernels("lines.take", points, counted, values, out=[((len(points),), F32)])
    np.testing.assert_array_equal(got[:300], values[mask])


@pytest.mark.parametrize("dtype", [I32, F32])
@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("sizes", [(0, 0), (2, 3), (40, 5)])
def test_local_maxima(kernels, dtype, wraps, sizes):
    values = np.random.default_rng(1).integers(0, 15, (33, 21)).astype(dtype)
    got = kernels("lines.local_maxima", values, 6, *sizes, wraps, out=[(values.shape, U8)])
    want = lines_reference.local_maxima(values, 6, sizes[0], sizes[1], wraps)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("number", [1, 64, 333])
def test_claim(kernels, number):
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 300, (number, 2)).astype(F32)
    codes = rng.integers(0, DIRECTIONS, number).astype(I32)
    theta = rng.uniform(-1.6, 1.6, 50)
    lines = [a.astype(F32) for a in (np.cos(theta), np.sin(theta), rng.uniform(-99, 300, 50))]
    directions = rng.integers(0, DIRECTIONS, 50).astype(I32)
    after = rng.integers(-1, 30, number).astype(I32)
    given: Any = points, codes, after, *lines, directions, 12.0, 2500
    got = kernels("segments.claim", *given, out=[((number,), I32)])
    want = lines_reference.claim(*given)
    np.testing.assert_array_equal(got, want)


def test_the_sets_give_equal_bits(all_kernels):
    shape = (97, 131)
    image, other = noise(*shape), noise(*shape, seed=1)
    dy, dx = waves(*shape)
    taps = noise(9, seed=2)
    states = np.random.default_rng(9).integers(0, 3, shape, U8)
    octets = np.random.default_rng(9).integers(0, 256, shape, U8)
    integers = octets.astype(I32)[None]
    planes = image[None]
    corners = np.argwhere(states == 2).astype(I32)

    def results(kernels):
        separable = taps, taps[:5], 1, Border.MIRROR, 0.0
        yield kernels("filters.correlate_separable", planes, *separable, out=[(planes.shape, F32)])
        pair = taps, other[0, :9], Border.REFLECT, 0.0, 0.0, 0.0
        yield from kernels("gradients.differentiate_polar", image, *pair, out=[(shape, F32)] * 4)
        ranks = 2, 1, 0, 8, Border.WRAP, 0
        yield kernels("rank.median", integers, *ranks, out=[(integers.shape, I32)])
        for norm in Norm:
            for rule in Thinning:
                given = norm, rule, 0.4, 0.9
                yield kernels("edges.thin", dy, dx, *given, out=[(shape, U8)])
            given = Border.REFLECT, 0.0, norm, 100.0, 400.0
            yield kernels("edges.thin_sobel", octets, *given, out=[(shape, U8)])
        yield kernels("edges.hysteresis", states, out=[(shape, U8)])
        yield kernels("edges.count_edges", dy, dx, states, out=[(shape[:1], I32)])
        yield kernels("shapes.code_directions", corners, dy, dx, out=[((len(corners),), I32)])
        for larger, shift in ((1, 0), (1, 2), (8, 1)):  # the last is more than one block holds
            sides = shape[0] * larger, shape[1] * larger
            given = *shape_votes(*sides), 60, *sides, shift
            cells = [((n - 1) >> shift) + 1 for n in sides]
            tiles = [-(-n // TILE) for n in cells]
            yield kernels("shapes.accumulate", *given, out=[((3, 2, *cells), I32)])
            yield kernels("shapes.search", *given, out=[((3, 2, *tiles), I32)])

    first, *others = [list(results(kernels)) for kernels in all_kernels]
    for found in others:
        for a, b in zip(first, found, strict=True):
            np.testing.assert_array_equal(a, b)
