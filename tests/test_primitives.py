"""Primitives of every kernel set against an oracle, and the sets against each other.

Filters, gradients, ranks and edges; those of other families have files of their own.

Kernels do float32 arithmetic in a stated order, so NumPy doing the same must give the same bits.
"""

import numpy as np
import pytest
import scipy.ndimage as ndi

from cvkern.kernels.codes.edges import Edge, Norm, Thinning
from cvkern.kernels.codes.filters import Border, Outside
from cvkern.kernels.codes.hough import TILE, Cells
from tests.edges import reference_edges as edges_reference
from tests.filters import reference_gradients as gradients_reference
from tests.filters import reference_linear as filters_reference
from tests.filters import reference_medians as rank_reference
from tests.hough.generalized.test_primitives import shape_votes
from tests.primitives import F32, I32, U8, noise, waves

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
        "filters.linear.correlate_separable", src, taps_y, taps_x, *options, out=[(src.shape, F32)]
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


@pytest.mark.parametrize("dtype", [U8, np.uint16])
@pytest.mark.parametrize(
    ("shape", "step", "radii", "border"),
    [
        ((1, 1, 1), 1, (1, 2), Border.MIRROR),
        ((2, 5, 6), 3, (7, 8), Border.WRAP),
        ((2, 67, 70), 2, (4, 2), Border.CONSTANT),  # planes that end within the rows taken at once
    ],
)
def test_correlate_integers(kernels, shape, step, radii, border, dtype):
    """The sums are those of float32, rounded to even; some are beyond the integers."""
    most = np.iinfo(dtype).max
    src = (
        np.random.default_rng(3).integers(0, most + 1, (*shape[:2], shape[2] * step)).astype(dtype)
    )
    taps_y, taps_x = (noise(2 * r + 1, seed=r + 1) for r in radii)
    options = step, border, 7.0
    got = kernels(
        "filters.linear.correlate_separable",
        src,
        taps_y,
        taps_x,
        *options,
        out=[(src.shape, dtype)],
    )
    sums = filters_reference.correlate_separable(src.astype(F32), taps_y, taps_x, *options)
    np.testing.assert_array_equal(got, np.rint(sums).clip(0, most))


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (37, 29), (20, 130)])
def test_differentiate_polar(kernels, shape):
    src = np.round(noise(*shape) * 2)  # with flat parts, where derivatives are 0
    taps = np.array([1, 2, 1], F32), np.array([-1, 0, 1], F32)
    dy, dx, magnitude, orientation = kernels(
        "filters.gradients.differentiate_polar", src, *taps, Outside(Border.NEAREST, 0.0, 0.0, 0.0),
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
            "filters.gradients.differentiate_polar", src, np.array([0, 1, 0], F32),
            np.array([-1, 0, 1], F32), Outside(Border.NEAREST, 0.0, 0.0, 0.0),
            out=[(src.shape, F32)] * 4,
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
    got = kernels("filters.medians.median", src, *given, out=[(shape, I32)])
    np.testing.assert_array_equal(got, rank_reference.median(src, radius, step, border, cval))


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (1, 37, 29)])
def test_root_mean_square(kernels, shape):
    dy, dx = noise(*shape), noise(*shape, seed=1)
    got = kernels("filters.gradients.root_mean_square", dy, dx, out=[(shape, F32)])
    np.testing.assert_array_equal(got, np.sqrt((dx * dx + dy * dy) * F32(0.5)))
    np.testing.assert_allclose(got, np.hypot(dy, dx, dtype=float) / np.sqrt(2), rtol=2e-7)


def test_keys_order_floats(kernels):
    values = np.concatenate([noise(500) * 1e3, noise(500) * 1e-3, [0.0, np.inf, -np.inf]])
    values = values.astype(F32).reshape(1, 17, 59)
    keys = kernels("filters.medians.keys_of_floats", values.view(I32), out=[(values.shape, I32)])
    order = np.argsort(values, axis=None, kind="stable")
    np.testing.assert_array_equal(np.argsort(keys, axis=None, kind="stable"), order)
    back = kernels("filters.medians.floats_of_keys", keys, out=[(values.shape, I32)])
    np.testing.assert_array_equal(back.view(F32), values)


def test_nan_of_either_sign_is_above_infinity(kernels):
    values = np.array([-np.nan, np.nan, np.inf, -1], F32)
    keys = kernels("filters.medians.keys_of_floats", values.view(I32), out=[(values.shape, I32)])
    assert keys[0] == keys[1] > keys[2] > 0 > keys[3]
    assert np.isnan(
        kernels("filters.medians.floats_of_keys", keys, out=[(keys.shape, I32)]).view(F32)[:2]
    ).all()


@pytest.mark.parametrize("border", Border)
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (9, 3), (37, 70)])
def test_differentiate(kernels, shape, border):
    src, smooth, slope = noise(*shape), noise(7, seed=1), noise(7, seed=2)
    beside = F32(0.6), F32(-0.2)
    outside = Outside(border, 0.3, *map(float, beside))
    got = kernels(
        "filters.gradients.differentiate", src, smooth, slope, outside,
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
        limits = np.array([low, high], F32)
        got = kernels("edges.masks.thin", dy, dx, norm, rule, limits, out=[(shape, U8)])
        want = edges_reference.thin(dy, dx, norm, rule, low, high)
        np.testing.assert_array_equal(got, want)


def test_thin_keeps_what_exceeds_the_limit_by_a_rounding(kernels):
    """The root of its square, by which neighbours are compared, may be that of the limit."""
    dx, dy = np.zeros((3, 200), F32), np.zeros((3, 200), F32)
    slopes = np.random.default_rng(8).uniform(1, 4, 100).astype(F32)
    limit = np.nextafter(slopes * slopes, F32(0))
    (same,) = np.nonzero(np.sqrt(limit) == np.sqrt(slopes * slopes))
    assert len(same) > 10
    dx[1, 5] = slopes[same[0]]
    limits = np.array([limit[same[0]]] * 2, F32)
    given = dy, dx, Norm.L2, Thinning.INTERPOLATED, limits
    states = kernels("edges.masks.thin", *given, out=[(dx.shape, U8)])
    assert states[1, 5] == Edge.STRONG
    assert states.sum() == Edge.STRONG


@pytest.mark.parametrize("l2", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (40, 1), (48, 65), (9, 1100)])
def test_thin_sobel_and_hysteresis_are_canny(kernels, shape, l2):
    cv2 = pytest.importorskip("cv2")
    image = np.random.default_rng(5).integers(0, 256, shape, U8, endpoint=False)
    smooth = ndi.uniform_filter(image, 3)
    for src in (image, smooth):
        low, high = 60, 150
        limits = (float(low**2), float(high**2)) if l2 else (float(low), float(high))
        norm = Norm.L2 if l2 else Norm.L1
        given = Border.NEAREST, 0.0, norm, *limits
        states = kernels("edges.masks.thin_sobel", src, *given, out=[(shape, U8)])
        mask = kernels("edges.masks.hysteresis", states, out=[(shape, U8)])
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
    got = kernels("edges.masks.thin_sobel", src, *given, out=[(src.shape, U8)])
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
    got = kernels("edges.masks.hysteresis", states, out=[(shape, U8)])
    np.testing.assert_array_equal(got, edges_reference.hysteresis(states))


@pytest.mark.parametrize("corner", [Edge.STRONG, Edge.WEAK])
def test_hysteresis_follows_a_long_line(kernels, corner):
    for states in (spiral(65), spiral(65)[::-1], spiral(65)[:, ::-1].T):
        states = np.where(states == Edge.STRONG, corner, states).astype(U8)
        got = kernels("edges.masks.hysteresis", states, out=[(states.shape, U8)])
        np.testing.assert_array_equal(got, (states > 0) & (corner == Edge.STRONG))


def test_hysteresis_follows_diagonals_of_a_large_image(kernels):
    """Threads of the CPU have slabs of rows; each diagonal crosses all of their seams."""
    down = np.eye(400, dtype=U8)
    down[0, 0] = Edge.STRONG
    for states in (down, down[:, ::-1], down[::-1], down[::-1, ::-1]):
        got = kernels("edges.masks.hysteresis", states, out=[(states.shape, U8)])
        np.testing.assert_array_equal(got, states > 0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 20), (20, 1), (45, 61)])
def test_subpixel_edges(kernels, shape):
    dy, dx = waves(*shape, seed=8)
    mask = (np.random.default_rng(8).random(shape) < 0.8).astype(U8)
    pixels, points, magnified = edges_reference.subpixel_edges(dy, dx, mask)
    counts = kernels("edges.subpixel.count_edges", dy, dx, mask, out=[(shape[:1], I32)])
    np.testing.assert_array_equal(counts, np.bincount(pixels[:, 0], minlength=shape[0]))

    n = len(pixels)
    starts = (np.cumsum(counts) - counts).astype(I32)
    out = [((n, 2), F32), ((n,), F32), ((n,), F32)]
    got, orientation, strength = kernels(
        "edges.subpixel.gather_edges", dy, dx, mask, starts, out=out
    )
    error = np.abs(got - points).max(1, initial=0)
    assert np.all(error <= 2**-24 * (magnified + max(shape)))  # the offset, then the sum
    y, x = pixels.T
    np.testing.assert_array_equal(strength, np.sqrt(dx[y, x] * dx[y, x] + dy[y, x] * dy[y, x]))
    np.testing.assert_array_equal(orientation, gradients_reference.orientation(dy[y, x], dx[y, x]))


# ---------------------------------------------------------------- the sets against each other


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
        yield kernels(
            "filters.linear.correlate_separable", planes, *separable, out=[(planes.shape, F32)]
        )
        pair = taps, other[0, :9], Outside(Border.REFLECT, 0.0, 0.0, 0.0)
        yield from kernels(
            "filters.gradients.differentiate_polar", image, *pair, out=[(shape, F32)] * 4
        )
        ranks = 2, 1, 0, 8, Border.WRAP, 0
        yield kernels("filters.medians.median", integers, *ranks, out=[(integers.shape, I32)])
        for norm in Norm:
            for rule in Thinning:
                given = norm, rule, np.array([0.4, 0.9], F32)
                yield kernels("edges.masks.thin", dy, dx, *given, out=[(shape, U8)])
            given = Border.REFLECT, 0.0, norm, 100.0, 400.0
            yield kernels("edges.masks.thin_sobel", octets, *given, out=[(shape, U8)])
        yield kernels("edges.masks.hysteresis", states, out=[(shape, U8)])
        yield kernels("edges.subpixel.count_edges", dy, dx, states, out=[(shape[:1], I32)])
        yield kernels(
            "hough.generalized.votes.code_directions", corners, dy, dx, out=[((len(corners),), I32)]
        )
        for larger, shift in ((1, 0), (1, 2), (8, 1)):  # the last is more than one block holds
            sides = shape[0] * larger, shape[1] * larger
            given = *shape_votes(*sides), 60, Cells(*sides, shift)
            cells = [((n - 1) >> shift) + 1 for n in sides]
            tiles = [-(-n // TILE) for n in cells]
            yield kernels("hough.generalized.votes.accumulate", *given, out=[((3, 2, *cells), I32)])
            yield kernels("hough.generalized.votes.search", *given, out=[((3, 2, *tiles), I32)])

    first, *others = [list(results(kernels)) for kernels in all_kernels]
    for found in others:
        for a, b in zip(first, found, strict=True):
            np.testing.assert_array_equal(a, b)
