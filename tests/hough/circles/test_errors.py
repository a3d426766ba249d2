"""Every error of circles and ellipses."""

import numpy as np
import pytest

import cvkern
from tests.refusals import DEEP, FLAT, refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

RANGES = {cvkern.detect_circles: "radius_range", cvkern.detect_ellipses: "axis_range"}
SEVERAL = {
    "hough_circle": (lambda x, **options: cvkern.hough_circle(x, 2, **options), "mask"),
    "hough_ellipse": (cvkern.hough_ellipse, "mask"),
    "detect_circles": (lambda x, **options: cvkern.detect_circles(x, (3, 9), **options), "image"),
    "detect_ellipses": (lambda x, **options: cvkern.detect_ellipses(x, (3, 9), **options), "image"),
}


@pytest.mark.parametrize("name", SEVERAL)
def test_pictures_of_circles(name):
    function, what = SEVERAL[name]
    flat = "2-D" if what == "mask" else "2-D or 3-D"
    refused(ValueError, f"{what} must be {flat}, got shape (4, 5, 3, 1)", function, DEEP[..., None])
    refused(ValueError, f"{what} must not be empty, got shape (0, 5)", function, np.zeros((0, 5)))
    message = f"{what} must hold real numbers, got dtype complex128"
    refused(TypeError, message, function, FLAT * 1j)
    strip = np.broadcast_to(np.uint8(0), (3, 70000))
    refused(ValueError, f"{what} must be in [1, 65536], got 70000", function, strip)


@pytest.mark.parametrize(("radius", "options", "error", "message"), [
    (0, {}, ValueError, "radius must be in [1, 5], got 0"),
    ([2, 6], {}, ValueError, "radius must be in [1, 5], got 6"),
    (20000, {"full_output": True}, ValueError, "radius must be in [1, 16384], got 20000"),
    (2.5, {}, TypeError, "radius must be an integer, got 2.5"),
    ([], {}, ValueError, "radius must be one integer or a sequence of them, got []"),
    ([[2]], {}, ValueError, "radius must be one integer or a sequence of them, got [[2]]"),
    (16384, {"full_output": True}, ValueError,
     "votes must have at most 536870912 elements, got 1074036756 in shape (1, 32772, 32773), which "
     "would take 4296147024 bytes"),
    (2, {"orientation_tolerance": -0.1}, ValueError,
     "orientation_tolerance must be >= 0 and finite, got -0.1"),
    (2, {"orientation_tolerance": 1.6}, ValueError,
     "orientation_tolerance must be < pi / 2, got 1.6"),
    (2, {"orientation": np.zeros((5, 4))}, ValueError,
     "orientation must have shape (4, 5), got (5, 4)"),
])  # fmt: skip
def test_hough_circle(radius, options, error, message):
    refused(error, message, cvkern.hough_circle, FLAT, radius, **options)


@pytest.mark.parametrize(("options", "error", "message"), [
    ({"hspaces": FLAT}, ValueError, "hspaces must be 3-D, got shape (4, 5)"),
    ({"radii": [2]}, ValueError, "radii must be one for each of 2 accumulators, got 1"),
    ({"radii": [2, 0]}, ValueError, "radii must be in [1, 16384], got 0"),
    ({"min_xdistance": 0}, ValueError, "min_xdistance must be in [1, 16384], got 0"),
    ({"min_ydistance": 1.5}, TypeError, "min_ydistance must be an integer, got 1.5"),
    ({"num_peaks": 0}, ValueError, "num_peaks must be in [1, 536870912], got 0"),
    ({"total_num_peaks": 0}, ValueError, "total_num_peaks must be in [1, 536870912], got 0"),
    ({"threshold": -1}, ValueError, "threshold must be >= 0 and finite, got -1"),
])  # fmt: skip
def test_hough_circle_peaks(options, error, message):
    given = {"hspaces": np.zeros((2, 4, 5)), "radii": [2, 3]} | options
    refused(error, message, cvkern.hough_circle_peaks, **given)


@pytest.mark.parametrize(("options", "error", "message"), [
    ({"threshold": -1}, ValueError, "threshold must be in [0, 536870912], got -1"),
    ({"threshold": 1.5}, TypeError, "threshold must be an integer, got 1.5"),
    ({"accuracy": 0}, ValueError, "accuracy must be > 0, got 0"),
    ({"accuracy": 1e-4}, ValueError, "accuracy must give at most 8192 bins, got 20002"),
    ({"min_size": 0}, ValueError, "min_size must be > 0, got 0"),
    ({"max_size": -1}, ValueError, "max_size must be > 0, got -1"),
    ({"orientation_tolerance": 0}, ValueError,
     "orientation_tolerance must be in (0, pi / 2), got 0"),
    ({"orientation": FLAT[1:]}, ValueError, "orientation must have shape (4, 5), got (3, 5)"),
])  # fmt: skip
def test_hough_ellipse(options, error, message):
    refused(error, message, cvkern.hough_ellipse, FLAT, **options)


@pytest.mark.parametrize("function", RANGES)
def test_detected_circles_and_ellipses(function):
    image, name = np.zeros((40, 50)), RANGES[function]
    for given, message in (
        ((3,), f"{name} must be two numbers, got (3,)"),
        (7, f"{name} must be two numbers, got 7"),
        ((2, 9), f"{name} must be >= 3 and finite, got 2"),
        ((9, 8), f"{name} must rise, got 9 to 8"),
        ((21, 30), f"{name} must begin at most at 20, got 21"),
        ((5, np.inf), f"{name} must be >= 3 and finite, got inf"),
    ):
        refused(ValueError, message, function, image, given)
    for options, message in (
        ({"min_support": 0}, "min_support must be in (0, 1], got 0"),
        ({"min_support": 1.5}, "min_support must be in (0, 1], got 1.5"),
        ({"min_distance": -1}, "min_distance must be >= 0 and finite, got -1"),
        ({"sigma": 0}, "sigma must be > 0, got 0"),
        ({"low_threshold": 3, "high_threshold": 2},
         "low_threshold must be <= high_threshold, got 3 > 2"),
    ):  # fmt: skip
        refused(ValueError, message, function, image, (3, 9), **options)
    message = "polarity must be one of ('any', 'bright', 'dark'), got 'white'"
    refused(ValueError, message, cvkern.detect_circles, image, (3, 9), polarity="white")
    message = "max_points must be in [3, 16384], got 2"
    refused(ValueError, message, cvkern.detect_ellipses, image, (3, 9), max_points=2)
