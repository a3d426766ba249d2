"""First derivatives against SciPy and OpenCV, and their rotation with the image."""

import cv2
import numpy as np
import pytest
import scipy.ndimage as ndi
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.calls import MODES, layouts, noise
from tests.edges.reference_canny import slopes
from tests.reference_rounding import U, gaussian_error, gaussian_kernel, separable_error

SHAPES = [(1, 1), (1, 40), (37, 1), (2, 2), (33, 70)]
SMOOTH = {"sobel": [1, 2, 1], "scharr": [3, 10, 3]}
INTEGER = ["sobel", "scharr"]  # operators of `gradient`
CV2_BORDERS = {
    "reflect": cv2.BORDER_REFLECT,
    "nearest": cv2.BORDER_REPLICATE,
    "mirror": cv2.BORDER_REFLECT_101,
}


def assert_polar(gradient):
    """`magnitude` and `orientation` must be those of `dy` and `dx`."""
    dy, dx = gradient.dy.astype(float), gradient.dx.astype(float)
    # Two squares, their sum and the root are rounded; squares of tiny numbers vanish.
    np.testing.assert_allclose(gradient.magnitude, np.hypot(dy, dx), rtol=3 * U, atol=1e-18)
    want = np.arctan2(dy, dx)
    turn = np.abs(gradient.orientation - want)
    # 1.4e-7 of the polynomial, and half a unit in the last place of pi (1.2e-7) for two sums
    assert np.minimum(turn, 2 * np.pi - turn).max() < 5e-7
    assert np.abs(gradient.orientation).max() <= np.float32(np.pi)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sigma", [0.3, 1.0, 4.5])
@pytest.mark.parametrize("shape", SHAPES)
def test_gaussian_gradient_is_scipys(backend, shape, sigma, mode):
    image = noise(*shape)
    got = cvkern.gradient(image, sigma=sigma, mode=mode, cval=-0.4)
    error = gaussian_error(image, sigma, (0, 1), cval=-0.4)
    for found, want in zip(got[:2], slopes(image, sigma, mode, -0.4), strict=True):
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, want, rtol=0, atol=error)
    assert_polar(got)


def test_a_gaussian_narrower_than_a_pixel_has_no_slope(backend):
    """Its kernel is a single tap, where the derivative of a Gaussian is 0 (as SciPy has it)."""
    assert not np.any(cvkern.gradient(noise(5, 6), sigma=0.1).magnitude)


@pytest.mark.parametrize("mode", CV2_BORDERS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", INTEGER)
def test_sobel_and_scharr_gradients_are_opencvs(backend, name, shape, mode):
    image = noise(*shape, dtype="uint8")
    got = cvkern.gradient(image, sigma=0, operator=name, mode=mode)
    if mode == "mirror" and min(shape) == 1:  # OpenCV, unlike SciPy, looks across: pad by hand
        wide = np.pad(image, 1, "reflect") if image.size > 1 else np.pad(image, 1, "edge")
    else:
        wide = cv2.copyMakeBorder(image, 1, 1, 1, 1, CV2_BORDERS[mode])
    operator = cv2.Sobel if name == "sobel" else cv2.Scharr
    inner = np.s_[1:-1, 1:-1]
    np.testing.assert_array_equal(got.dx, operator(wide, cv2.CV_32F, 1, 0)[inner])
    np.testing.assert_array_equal(got.dy, operator(wide, cv2.CV_32F, 0, 1)[inner])
    assert_polar(got)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", INTEGER)
def test_sobel_and_scharr_gradients_come_after_a_gaussian(backend, name, mode):
    image = noise(21, 35)
    got = cvkern.gradient(image, sigma=1.3, operator=name, mode=mode, cval=0.5)
    blurred = ndi.gaussian_filter(image.astype(float), 1.3, mode=mode, cval=0.5)
    kernel = np.outer(SMOOTH[name], [-1, 0, 1])
    want_dx = ndi.correlate(blurred, kernel, mode=mode, cval=0.5)
    want_dy = ndi.correlate(blurred, kernel.T, mode=mode, cval=0.5)
    blur = gaussian_kernel(1.3)
    error = separable_error(image, blur, blur, SMOOTH[name], [-1, 0, 1])
    np.testing.assert_allclose(got.dy, want_dy, rtol=0, atol=error)
    np.testing.assert_allclose(got.dx, want_dx, rtol=0, atol=error)
    assert_polar(got)


def test_constant_border_of_sobel_is_cval(backend):
    image = noise(6, 7, dtype="uint8")
    got = cvkern.gradient(image, sigma=0, operator="sobel", mode="constant", cval=9)
    wide = np.pad(image, 1, constant_values=9)
    np.testing.assert_array_equal(got.dx, cv2.Sobel(wide, cv2.CV_32F, 1, 0)[1:-1, 1:-1])


@pytest.mark.parametrize("angle", np.deg2rad([0, 30, 45, 90, 135, 180, -60, -90, -135]))
def test_orientation_points_up_the_slope(backend, angle):
    y, x = np.mgrid[-9:10, -9:10]
    ramp = np.sin(angle) * y + np.cos(angle) * x
    for operator, sigma, gain in (("gaussian", 1.0, 1), ("sobel", 0, 8), ("scharr", 1.0, 32)):
        got = cvkern.gradient(ramp, sigma=sigma, operator=operator)
        inside = np.s_[8:11, 8:11]  # no border within reach of the kernels
        turn = np.abs(got.orientation[inside] - angle)
        # The ramp reaches 13, its derivative is gain: their rounding over gain, few times.
        assert np.minimum(turn, 2 * np.pi - turn).max() < 2e-5
        # The tails of the Gaussian beyond 4 sigma hold 1e-3 of its second moment.
        np.testing.assert_allclose(got.magnitude[inside], gain, rtol=2e-3)


def test_layout_and_dtype_do_not_matter(backend, tmp_path):
    image = noise(14, 37, dtype="uint8")
    for call in (cvkern.gradient, cvkern.sobel, cvkern.scharr):
        want = call(image)
        for name, laid_out in (*layouts(image, tmp_path), ("list", image.tolist())):
            np.testing.assert_array_equal(call(laid_out), want, err_msg=name)
    for dtype in ("int64", "float16", "float32", "float64", ">i4"):
        np.testing.assert_array_equal(call(image.astype(dtype)), want, err_msg=dtype)


# --- properties ----------------------------------------------------------------------------------

shapes = st.tuples(st.integers(1, 24), st.integers(1, 80))
modes = st.sampled_from(MODES)
seeds = st.integers(0, 2**16)


@given(shape=shapes, name=st.sampled_from(["sobel", "scharr"]), mode=modes, seed=seeds)
def test_integer_gradients_turn_with_the_image(backend, shape, name, mode, seed):
    """Sums of small integers are exact in any order: equal, not nearly equal."""

    def slopes(x):
        return cvkern.gradient(x, sigma=0, operator=name, mode=mode)[:2]

    image = noise(*shape, dtype="uint8", seed=seed)
    dy, dx = slopes(image)
    np.testing.assert_array_equal(slopes(image.T), (dx.T, dy.T))
    np.testing.assert_array_equal(slopes(image[::-1]), (-dy[::-1], dx[::-1]))
    np.testing.assert_array_equal(slopes(image[:, ::-1]), (dy[:, ::-1], -dx[:, ::-1]))
    np.testing.assert_array_equal(slopes(255 - image.astype(int)) if mode != "constant" else
                                  (-dy, -dx), (-dy, -dx))  # fmt: skip


@given(shape=shapes, sigma=st.floats(0.3, 4), mode=modes, seed=seeds)
def test_gaussian_gradients_turn_with_the_image(backend, shape, sigma, mode, seed):
    image = noise(*shape, seed=seed)
    got = cvkern.gradient(image, sigma=sigma, mode=mode)
    turned = cvkern.gradient(image.T, sigma=sigma, mode=mode)
    error = 2 * gaussian_error(image, sigma, (0, 1))
    np.testing.assert_allclose(turned.dy.T, got.dx, rtol=0, atol=error)
    np.testing.assert_allclose(turned.dx.T, got.dy, rtol=0, atol=error)
    assert_polar(got)


@given(shape=shapes, value=st.floats(-1e6, 1e6, width=32), sigma=st.floats(0.3, 3))
def test_constants_have_no_slope(backend, shape, value, sigma):
    image = np.full(shape, value, np.float32)
    assert cvkern.gradient(image, sigma=sigma).magnitude.max() <= 2 * gaussian_error(
        image, sigma, (0, 1)
    )
    for name in INTEGER:
        assert not cvkern.gradient(image, sigma=0, operator=name, mode="mirror").magnitude.any()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nan_and_infinity_touch_their_window_only(backend, value):
    image = noise(30, 50)
    want = cvkern.gradient(image, sigma=1.0)
    image[12, 40] = value
    got = cvkern.gradient(image, sigma=1.0)
    touched = np.zeros(image.shape, bool)
    touched[8:17, 36:45] = True
    for a, b in zip(got, want, strict=True):
        np.testing.assert_array_equal(a[~touched], b[~touched])
    assert not np.isfinite(got.magnitude[touched]).any()
