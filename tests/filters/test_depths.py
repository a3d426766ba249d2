"""Images of 8 and 16 bits: read as they are, and results rounded to them."""

import cv2
import numpy as np
import pytest

import cvkern
from tests.primitives import F32

BYTE, WORD = np.uint8, np.uint16


def image(shape, dtype):
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)


@pytest.mark.parametrize("size", [1, 3, 4095, 4096, 9001])
@pytest.mark.parametrize("dtype", [BYTE, WORD])
def test_widen(kernels, dtype, size):
    values = image((1, size), dtype)
    got = kernels("filters.depths.widen", values, out=[(values.shape, F32)])
    np.testing.assert_array_equal(got, values.astype(F32))


@pytest.mark.parametrize("size", [1, 3, 4095, 4096, 9001])
@pytest.mark.parametrize("dtype", [BYTE, WORD])
def test_narrow(kernels, dtype, size):
    """Halves go to the even number, what lies beyond the limits to them, and NaN to 0."""
    most = np.iinfo(dtype).max
    values = np.random.default_rng(1).integers(-9, 2 * most + 9, (1, size)).astype(F32) / 2
    values[0, ::7] += F32(0.25)
    special = np.array([np.nan, -np.inf, np.inf, 1e30, -0.0, most + 0.5, 0.5, 1.5], F32)
    values[0, : len(special)] = special[:size]
    want = np.nan_to_num(np.rint(values), nan=0, posinf=most).clip(0, most).astype(dtype)
    got = kernels("filters.depths.narrow", values, out=[(values.shape, dtype)])
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("dtype", [BYTE, WORD])
@pytest.mark.parametrize("shape", [(1, 1), (33, 57), (20, 31, 3)])
def test_results_are_rounded(backend, dtype, shape):
    values = image(shape, dtype)
    axis = None if len(shape) == 2 else -1
    real = values.astype(F32)
    for function in (
        lambda x, **o: cvkern.gaussian(x, 1.5, **o),
        lambda x, **o: cvkern.box(x, (1, 2), mode="wrap", **o),
        lambda x, **o: cvkern.correlate_separable(x, ([1], [3.0, -2.0, 0.5]), **o),
    ):
        want = function(real, channel_axis=axis)
        np.testing.assert_array_equal(function(values, channel_axis=axis), want)
        got = function(values, channel_axis=axis, dtype=dtype)
        assert got.dtype == dtype
        want = np.rint(want).clip(0, np.iinfo(dtype).max).astype(dtype)
        np.testing.assert_array_equal(got, want)
        np.testing.assert_array_equal(function(real, channel_axis=axis, dtype=dtype), want)


@pytest.mark.parametrize("axis", [0, 1])
def test_channels_first_and_between(backend, axis):
    values = image((5, 21, 34) if axis == 0 else (21, 5, 34), BYTE)
    want = np.rint(cvkern.gaussian(values.astype(F32), 2.0, channel_axis=axis)).astype(BYTE)
    got = cvkern.gaussian(values, 2.0, channel_axis=axis, dtype="uint8")
    np.testing.assert_array_equal(got, want)


def test_a_blur_of_bytes_is_that_of_opencv(backend):
    """OpenCV's taps have 8 bits behind the point there: one step apart."""
    values = image((90, 121), BYTE)
    got = cvkern.gaussian(values, 2.0, truncate=4, mode="mirror", dtype="uint8")
    want = cv2.GaussianBlur(values, (17, 17), 2.0)
    assert np.abs(got.astype(int) - want).max() <= 1
    assert (got == want).mean() > 0.75


def test_a_result_of_bytes_is_filled_in_place(backend):
    values, out = image((12, 17), BYTE), np.empty((12, 17), BYTE)
    assert cvkern.box(values, dtype=np.uint8, out=out) is out
    np.testing.assert_array_equal(out, cvkern.box(values, dtype="uint8"))


@pytest.mark.parametrize("function", [cvkern.gradient, cvkern.sobel, cvkern.canny])
@pytest.mark.parametrize("dtype", [BYTE, WORD])
def test_derivatives_of_integers_are_those_of_floats(backend, function, dtype):
    values = image((20, 31), dtype)
    options = {"high_threshold": 99} if function is cvkern.canny else {}
    for got, want in zip(
        function(values, **options), function(values.astype(F32), **options), strict=True
    ):
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("dtype", ["int8", "float64", "bytes", object, 3])
def test_other_dtypes_are_refused(no_kernel_runs, dtype):
    with pytest.raises(ValueError, match=r"dtype must be one of \('float32', 'uint8', 'uint16'\)"):
        cvkern.gaussian(np.ones((4, 5)), dtype=dtype)


def test_calls_on_bytes_are_captured(gpu):
    torch = pytest.importorskip("torch")
    values = torch.from_numpy(image((40, 71), BYTE)).cuda()
    replay = cvkern.capture(cvkern.gaussian, values, 2.0, dtype="uint8")
    want = cvkern.gaussian(values.cpu().numpy(), 2.0, dtype="uint8")
    np.testing.assert_array_equal(replay().cpu().numpy(), want)
