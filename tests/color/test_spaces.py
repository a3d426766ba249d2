"""Colour spaces, differences and adaptation: standards, published values and the way back."""

import numpy as np
import pytest
from skimage.color import deltaE_ciede2000

import cvkern
from cvkern.color.spaces import _steps
from cvkern.kernels.codes.color import Form
from tests.color import reference_color as reference
from tests.primitives import F32, U8

COLOURS = np.random.default_rng(0).random((60, 7, 3))
# Sharma, Wu and Dalal 2005, table 1: pairs 1, 4, 7, 9, 13, 17, 20, 25 and 34.
PAIRS = [
    ([50, 2.6772, -79.7751], [50, 0, -82.7485], 2.0425),
    ([50, -1.3802, -84.2814], [50, 0, -82.7485], 1.0),
    ([50, 0, 0], [50, -1, 2], 2.3669),
    ([50, 2.49, -0.001], [50, -2.49, 0.0009], 7.1792),
    ([50, -0.001, 2.49], [50, 0.0009, -2.49], 4.8045),
    ([50, 2.5, 0], [73, 25, -18], 27.1492),
    ([50, 2.5, 0], [58, 24, 15], 19.4535),
    ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
    ([2.0776, 0.0795, -1.135], [0.9033, -0.0636, -0.5514], 0.9082),
]


def test_spaces_are_those_of_the_standards(backend):
    """Float32 has 6e-8 of a value, and some of it is lost in each of the few steps."""
    to_xyz, white = reference.rgb_to_xyz()
    linear = reference.srgb_to_linear(COLOURS)
    want = {"rgb": linear, "xyz": linear @ to_xyz.T, "srgb": COLOURS}
    want["lab"] = reference.lab(want["xyz"], white)
    a, b = want["lab"][..., 1], want["lab"][..., 2]
    hue = np.degrees(np.arctan2(b, a)) % 360
    want["lch"] = np.stack([want["lab"][..., 0], np.hypot(a, b), hue], -1)
    for target, values in want.items():
        got = cvkern.convert_color(COLOURS, "srgb", target)
        assert got.dtype == np.float32
        np.testing.assert_allclose(got, values, rtol=2e-6, atol=1e-4 if target[0] == "l" else 1e-6)
        back = cvkern.convert_color(got, target, "srgb")
        # In the dark, the curve and the matrix make about 40 of a rounding.
        np.testing.assert_allclose(back, COLOURS, atol=2e-5)


def test_bytes(backend):
    """Each linear value gets the nearest code, and each code comes back."""
    codes = np.arange(256, dtype=np.uint8)
    image = np.stack([codes, codes[::-1], np.roll(codes, 9)], -1)
    linear = cvkern.convert_color(image, "srgb", "rgb")
    np.testing.assert_allclose(linear, reference.srgb_to_linear(image / 255), atol=5e-7)
    np.testing.assert_array_equal(
        cvkern.convert_color(linear, "rgb", "srgb", dtype=np.uint8), image
    )
    deep = cvkern.convert_color(image.astype(np.uint16) * 257, "srgb", "rgb")
    np.testing.assert_allclose(deep, linear, rtol=1e-6)
    wide = np.random.default_rng(1).uniform(-0.1, 1.1, (5000, 3)).astype(np.float32)
    got = cvkern.convert_color(wide, "rgb", "srgb", dtype=np.uint8)
    # The matrix is the unit matrix only to rounding: codes may differ where it is 0.49999.
    want = reference.srgb_curve(wide.astype(float).clip(0, 1)) * 255
    assert np.abs(got - want).max() < 0.5 + 1e-3


def test_bytes_step_up_at_their_thresholds(kernels):
    """A threshold has the next code already, the float32 before it has not."""
    numbers = np.append(np.eye(3), 1).astype(F32)
    middle = (np.arange(255) + 0.5) / 255
    values = np.float32(reference.srgb_to_linear(middle)).reshape(85, 3)
    given = int(Form.LINEAR), numbers, _steps()
    for colours, first in ((values, 1), (np.nextafter(values, F32(-1)), 0)):
        got = kernels("color.spaces.encode", colours, *given, out=[((85, 3), U8)])
        np.testing.assert_array_equal(got.ravel(), first + np.arange(255))


@pytest.mark.parametrize("source", ["srgb", "rgb", "lab"])
def test_nan_stays_nan_and_is_zero_in_bytes(backend, source):
    image = np.array([[0.2, 0.3, 0.4], [np.nan] * 3, [1.0, 1.0, 1.0]])
    got = cvkern.convert_color(image, source, "srgb")
    np.testing.assert_array_equal(np.isnan(got), np.isnan(image))
    got = cvkern.convert_color(image, source, "srgb", dtype=np.uint8)
    np.testing.assert_array_equal(got[1], 0)


def test_white_of_lab_is_that_asked_for(backend):
    white = cvkern.spectrum_to_xyz(np.ones(81), light="D50")
    got = cvkern.convert_color(white, "xyz", "lab", white="D50")
    np.testing.assert_allclose(got, [100, 0, 0], atol=1e-4)
    cones = cvkern.convert_color(np.ones(3), "xyz", "lms")
    np.testing.assert_allclose(cones, 1, atol=2e-5)  # the matrix has five digits


def test_ciede2000(backend):
    first, second, want = map(np.array, zip(*PAIRS, strict=True))
    got = cvkern.deltaE_ciede2000(first, second)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, want, atol=5.1e-5)  # four digits are published
    rng = np.random.default_rng(2)
    first = (rng.normal(size=(20, 25, 3)) * [20, 40, 40] + [50, 0, 0]).astype(np.float32)
    second = first + rng.normal(size=first.shape).astype(np.float32) * 9
    want = deltaE_ciede2000(first.astype(float), second.astype(float), kL=2)
    np.testing.assert_allclose(cvkern.deltaE_ciede2000(first, second, kL=2), want, rtol=3e-6)


def test_adaptation_joins_the_matrix(backend):
    """One pass, with the bytes of three."""
    linear = np.random.default_rng(3).random((7, 9, 3)).astype(np.float32)
    xyz = cvkern.adapt_colors(cvkern.convert_color(linear, "rgb", "xyz"), "A", "D65")
    want = cvkern.convert_color(xyz, "xyz", "rgb")
    got = cvkern.convert_color(linear, "rgb", "rgb", adapt=("A", "D65"))
    # Three roundings of 6e-8 of sums up to 3 against one.
    np.testing.assert_allclose(got, want, atol=3e-6)
    codes = cvkern.convert_color(linear, "rgb", "srgb", adapt=["A", "D65"], dtype="uint8")
    np.testing.assert_allclose(codes, 255 * reference.srgb_curve(want.clip(0, 1)), atol=0.51)


def test_adaptation():
    """Lindbloom's matrices of Bradford and von Kries, from D65 to D50 as ASTM E308 has them."""
    whites = (0.95047, 1, 1.08883), (0.96422, 1, 0.82521)
    published = {
        "bradford": [[1.0478112, 0.0228866, -0.0501270], [0.0295424, 0.9904844, -0.0170491],
                     [-0.0092345, 0.0150436, 0.7521316]],
        "von_kries": [[1.0160803, 0.0552297, -0.0521326], [0.0060666, 0.9955661, -0.0012235],
                      [0, 0, 0.7578869]],
    }  # fmt: skip
    for method, want in published.items():
        got = cvkern.adaptation_matrix(*whites, method)
        np.testing.assert_allclose(got, want, atol=2e-7)
    for method in ("bradford", "von_kries", "cat16"):
        got = cvkern.adapt_colors([whites[0]], *whites, method)
        np.testing.assert_allclose(got, [whites[1]], atol=1e-6)


@pytest.mark.parametrize(
    ("error", "message", "call"),
    [
        (ValueError, "source must be one of ('srgb', 'rgb', 'xyz', 'lms', 'lab', 'lch'), got 'hsv'",
         lambda: cvkern.convert_color(COLOURS, "hsv", "lab")),
        (ValueError, "image must have shape (..., 3), got (4, 4)",
         lambda: cvkern.convert_color(np.eye(4), "srgb", "lab")),
        (ValueError, "dtype must be float32 for 'lab', got uint8",
         lambda: cvkern.convert_color(COLOURS, "srgb", "lab", dtype=np.uint8)),
        (ValueError, "dtype must be float32 or uint8, got float64",
         lambda: cvkern.convert_color(COLOURS, "srgb", "lab", dtype=float)),
        (ValueError, "white must be three positive numbers, got [1, 0, 1]",
         lambda: cvkern.convert_color(COLOURS, "xyz", "lab", white=[1, 0, 1])),
        (ValueError, "adapt must be a pair of lights, got 'A'",
         lambda: cvkern.convert_color(COLOURS, "xyz", "lab", adapt="A")),
        (ValueError, "adapt must be three positive numbers, got [1, 0, 1]",
         lambda: cvkern.convert_color(COLOURS, "xyz", "lab", adapt=("A", [1, 0, 1]))),
        (ValueError, "lab1 must have shape (..., 3), got (4, 4)",
         lambda: cvkern.deltaE_ciede2000(np.eye(4), np.eye(4))),
        (ValueError, "lab2 must have the shape of lab1, (3, 3), got (2, 3)",
         lambda: cvkern.deltaE_ciede2000(np.eye(3), np.ones((2, 3)))),
        (ValueError, "method must be one of ('von_kries', 'bradford', 'cat16'), got 'cat02'",
         lambda: cvkern.adaptation_matrix("D65", "D50", "cat02")),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, error, message, call):
    with pytest.raises(error) as info:
        call()
    assert str(info.value) == message
