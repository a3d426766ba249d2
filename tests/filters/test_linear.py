"""Linear filters against SciPy, and the properties of their kinds."""

from typing import Any

import numpy as np
import pytest
import scipy.ndimage as ndi
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.calls import DTYPES, MODES, layouts, noise
from tests.reference_rounding import gaussian_error, gaussian_kernel, separable_error

SHAPES = [(1, 1), (1, 40), (37, 1), (7, 5), (33, 70), (300, 5)]


def assert_within(got, want, error):
    assert got.dtype == np.float32
    assert got.shape == want.shape
    np.testing.assert_allclose(got, want, rtol=0, atol=error)


# --- against SciPy -------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sigma", [0, 0.4, (2.0, 5.0), 12.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_gaussian_is_scipys(backend, shape, sigma, mode):
    image = noise(*shape)
    got = cvkern.gaussian(image, sigma, mode=mode, cval=-2.5)
    want = ndi.gaussian_filter(image.astype(float), sigma, mode=mode, cval=-2.5)
    assert_within(got, want, gaussian_error(image, sigma, cval=-2.5))


@pytest.mark.parametrize("truncate", [0.0, 1.0, 2.6, 6.0])
@pytest.mark.parametrize("sigma", [0.1, 0.7, 1.9])
@pytest.mark.parametrize("order", [0, 1, 2, 3, 4, 7, (0, 1), (2, 0), (3, 5)])
def test_derivatives_are_scipys(backend, order, sigma, truncate):
    image = noise(23, 31)
    got = cvkern.gaussian(image, sigma, order=order, truncate=truncate)
    want = ndi.gaussian_filter(image.astype(float), sigma, order, truncate=truncate)
    assert_within(got, want, gaussian_error(image, sigma, order, truncate))


def test_an_axis_with_sigma_zero_is_left_alone_whatever_its_order(backend):
    image = noise(9, 12)
    got = cvkern.gaussian(image, (0, 1.5), order=(2, 1))
    want = ndi.gaussian_filter1d(image.astype(float), 1.5, 1, 1)
    assert_within(got, want, gaussian_error(image, 1.5, 1))


@pytest.mark.parametrize("dtype", DTYPES)
def test_values_of_every_dtype_count_as_they_are(backend, dtype):
    image = noise(12, 15, dtype=dtype)
    given_as_float = image.astype(float)
    got = cvkern.gaussian(image, 1.2)
    want = ndi.gaussian_filter(given_as_float, 1.2)
    assert_within(got, want, gaussian_error(given_as_float, 1.2))


@pytest.mark.parametrize("axis", [0, 1, 2, -1, -2, -3])
@pytest.mark.parametrize("channels", [1, 3, 40])
@pytest.mark.parametrize("mode", MODES)
def test_channels_are_filtered_apart(backend, axis, channels, mode):
    planes = noise(channels, 11, 14)
    image = np.moveaxis(planes, 0, axis)
    taps = [0.5, -1, 2, 0, 1], [3, 1, -1]
    got = {
        "gaussian": cvkern.gaussian(image, (2, 1), mode=mode, cval=0.5, channel_axis=axis),
        "correlate": cvkern.correlate_separable(
            image, taps, mode=mode, cval=0.5, channel_axis=axis
        ),
        "box": cvkern.box(image, (2, 1), mode=mode, cval=0.5, channel_axis=axis),
    }
    for i, plane in enumerate(planes):
        want = {
            "gaussian": cvkern.gaussian(plane, (2, 1), mode=mode, cval=0.5),
            "correlate": cvkern.correlate_separable(plane, taps, mode=mode, cval=0.5),
            "box": cvkern.box(plane, (2, 1), mode=mode, cval=0.5),
        }
        for name in want:
            np.testing.assert_array_equal(np.take(got[name], i, axis), want[name], err_msg=name)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", SHAPES)
def test_correlate_separable_is_scipys(backend, shape, mode):
    image, rng = noise(*shape), np.random.default_rng(1)
    for radii in ((0, 0), (1, 2), (9, 25)):
        down, along = (rng.normal(size=2 * r + 1) for r in radii)
        got = cvkern.correlate_separable(image, (down, along), mode=mode, cval=1.5)
        want = ndi.correlate1d(image.astype(float), down, 0, mode=mode, cval=1.5)
        want = ndi.correlate1d(want, along, 1, mode=mode, cval=1.5)
        assert_within(got, want, separable_error(image, down, along, cval=1.5))


@pytest.mark.parametrize("dtype", ["float32", "uint8", "uint16"])
@pytest.mark.parametrize("mode", ["reflect", "constant", "nearest", "mirror"])
def test_narrow_images_have_the_bits_of_short_ones(backend, mode, dtype):
    """On the CPU, columns of high images are filtered as rows."""
    for shape, options in (
        ((300, 1), {}), ((300, 16), {}), ((300, 2, 3), {"channel_axis": -1}),
        ((2, 300, 1, 4), {"channel_axis": -1, "batch_axis": 0}),
    ):  # fmt: skip
        image = noise(*shape, dtype=dtype)
        rows = (slice(None), slice(0, 200)) if "batch_axis" in options else slice(0, 200)
        part = (rows[0], slice(0, 190)) if isinstance(rows, tuple) else slice(0, 190)
        given = {"mode": mode, "cval": 3.0, **options}
        given |= {"dtype": dtype} if dtype == "uint8" else {}
        whole = cvkern.gaussian(image, (2, 1), **given)
        short = cvkern.gaussian(image[rows], (2, 1), **given)
        np.testing.assert_array_equal(whole[part], short[part])


def test_one_kernel_serves_both_axes(backend):
    image, taps = noise(8, 9), [0.25, 1, -3]
    for one in (taps, tuple(taps), np.array(taps)):
        got = cvkern.correlate_separable(image, one)
        np.testing.assert_array_equal(got, cvkern.correlate_separable(image, (taps, taps)))
    pair = np.array([taps, taps])
    np.testing.assert_array_equal(cvkern.correlate_separable(image, pair), got)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("radius", [0, 1, (4, 0), (2, 30)])
@pytest.mark.parametrize("shape", SHAPES)
def test_box_is_scipys(backend, shape, radius, mode):
    image = noise(*shape)
    size: Any = 2 * np.broadcast_to(radius, 2) + 1
    got = cvkern.box(image, radius, mode=mode, cval=4.0)
    want = ndi.uniform_filter(image.astype(float), size, mode=mode, cval=4.0)
    assert_within(got, want, separable_error(image, *(np.ones(n) / n for n in size), cval=4.0))


# --- what lies in memory -------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32", "float64"])
def test_layout_does_not_matter(backend, dtype, tmp_path):
    image = noise(13, 37, dtype=dtype)
    want = cvkern.gaussian(image, 1.5)
    for name, laid_out in layouts(image, tmp_path):
        np.testing.assert_array_equal(laid_out, image)
        np.testing.assert_array_equal(cvkern.gaussian(laid_out, 1.5), want, err_msg=name)
    np.testing.assert_array_equal(cvkern.gaussian(image.tolist(), 1.5), want)
    np.testing.assert_array_equal(cvkern.gaussian([tuple(r) for r in image.tolist()], 1.5), want)


def test_broadcast_images(backend):
    image = np.broadcast_to(noise(1, 50), (20, 50))
    np.testing.assert_array_equal(cvkern.gaussian(image, 2), cvkern.gaussian(image.copy(), 2))


@pytest.mark.parametrize("shape", [(20, 30), (3, 40, 50), (40, 3, 50), (40, 50, 3)])
def test_out_is_filled_and_returned(backend, shape):
    image = noise(*shape)
    axis = {"channel_axis": shape.index(3)} if len(shape) == 3 else {}
    for filtered in (
        lambda **out: cvkern.gaussian(image, 1.5, **axis, **out),
        lambda **out: cvkern.correlate_separable(image, [1, 2, 3], **axis, **out),
        lambda **out: cvkern.box(image, 2, **axis, **out),
    ):
        out = np.full(shape, np.nan, np.float32)
        assert filtered(out=out) is out
        np.testing.assert_array_equal(out, filtered())


# --- properties ----------------------------------------------------------------------------------

shapes = st.tuples(st.integers(1, 24), st.integers(1, 80))
sigmas = st.tuples(st.floats(0, 5), st.floats(0, 5))
modes = st.sampled_from(MODES)
seeds = st.integers(0, 2**16)


@given(shape=shapes, sigma=sigmas, mode=modes, value=st.floats(-1e6, 1e6, width=32))
def test_gaussian_keeps_constants(backend, shape, sigma, mode, value):
    image = np.full(shape, value, np.float32)
    got = cvkern.gaussian(image, sigma, mode=mode, cval=value)
    assert_within(got, image, gaussian_error(image, sigma))


@given(shape=shapes, sigma=sigmas, seed=seeds)
def test_gaussian_with_wrap_keeps_the_mean(backend, shape, sigma, seed):
    image = noise(*shape, seed=seed)
    got = cvkern.gaussian(image, sigma, mode="wrap")
    # A mean is not further out than its worst element.
    assert abs(got.mean(dtype=float) - image.mean(dtype=float)) <= gaussian_error(image, sigma)


@given(shape=shapes, sigma=sigmas, order=st.integers(0, 2), mode=modes, seed=seeds)
def test_gaussian_is_linear(backend, shape, sigma, order, mode, seed):
    a, b = noise(*shape, seed=seed), noise(*shape, seed=seed + 1)
    options = {"order": order, "mode": mode}
    got = cvkern.gaussian(a - 2 * b.astype(float), sigma, **options)
    parts = [cvkern.gaussian(x, sigma, **options).astype(float) for x in (a, b)]
    # Each of the three results is wrong by at most this; |a - 2 b| <= 2 is the largest image.
    error = gaussian_error(np.full(shape, 2.0), sigma, order)
    assert_within(got, parts[0] - 2 * parts[1], 4 * error)


@given(shape=shapes, dtype=st.sampled_from(DTYPES), mode=modes, seed=seeds)
def test_sigma_zero_is_the_identity(backend, shape, dtype, mode, seed):
    image = noise(*shape, dtype=dtype, seed=seed)
    for same in (cvkern.gaussian(image, 0, mode=mode), cvkern.box(image, 0, mode=mode)):
        assert same.dtype == np.float32
        np.testing.assert_array_equal(same, image.astype(np.float32))


@given(shape=shapes, sigma=st.floats(0, 5), mode=modes, seed=seeds)
def test_flips_and_transposition_commute_with_gaussian(backend, shape, sigma, mode, seed):
    image = noise(*shape, seed=seed)
    got = cvkern.gaussian(image, sigma, mode=mode)
    error = 2 * gaussian_error(image, sigma)
    for turn in (np.flipud, np.fliplr, np.transpose):
        assert_within(cvkern.gaussian(turn(image), sigma, mode=mode), turn(got), error)


@given(shape=shapes, sigma=sigmas, seed=seeds, place=st.tuples(st.floats(0, 1), st.floats(0, 1)))
def test_nan_and_infinity_touch_their_window_only(backend, shape, sigma, seed, place):
    image = noise(*shape, seed=seed)
    y, x = (int(p * (n - 1)) for p, n in zip(place, shape, strict=True))
    radius = [len(gaussian_kernel(s)) // 2 for s in sigma]
    rows, columns = (slice(max(0, c - r), c + r + 1) for c, r in zip((y, x), radius, strict=True))
    touched = np.zeros(shape, bool)
    touched[rows, columns] = True
    want = cvkern.gaussian(image, sigma, mode="constant")
    for value in (np.nan, np.inf, -np.inf):
        image[y, x] = value
        got = cvkern.gaussian(image, sigma, mode="constant")
        np.testing.assert_array_equal(got[~touched], want[~touched])
        np.testing.assert_array_equal(got[touched], value)  # taps are positive


def test_the_kernel_may_be_longer_than_the_row_of_lanes(backend):
    """Rows shorter and longer than a vector of pixels, the kernel reaching over both ends."""
    taps = np.random.default_rng(2).normal(size=2 * 75 + 1)
    for width in (1, 31, 32, 33, 63, 64, 65, 130):
        image = noise(3, width)
        got = cvkern.correlate_separable(image, (taps, taps), mode="mirror")
        want = ndi.correlate1d(image.astype(float), taps, 0, mode="mirror")
        want = ndi.correlate1d(want, taps, 1, mode="mirror")
        assert_within(got, want, separable_error(image, taps, taps))
