"""Every error of lines and segments."""

import numpy as np
import pytest

import cvkern
from cvkern._checks import MAX_ELEMENTS
from tests.refusals import DEEP, FLAT, refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

MASK = np.ones((4, 5), bool)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({}, ValueError, "mask or points must be given, got neither"),
        ({"mask": MASK, "points": [[1, 2]]}, ValueError, "mask or points must be given, got both"),
        (
            {"points": [[1, 2]]},
            ValueError,
            "shape must be given with points and only then, got None",
        ),
        (
            {"mask": MASK, "shape": (4, 5)},
            ValueError,
            "shape must be given with points and only then, got (4, 5)",
        ),
        ({"mask": MASK[0]}, ValueError, "mask must be 2-D, got shape (5,)"),
        ({"mask": MASK[:0]}, ValueError, "mask must not be empty, got shape (0, 5)"),
        ({"mask": MASK * 1j}, TypeError, "mask must hold real numbers, got dtype complex128"),
        ({"mask": MASK, "theta": 3}, ValueError, "theta must be 1-D and not empty, got shape ()"),
        (
            {"mask": MASK, "theta": []},
            ValueError,
            "theta must be 1-D and not empty, got shape (0,)",
        ),
        ({"mask": MASK, "theta": [0, np.nan]}, ValueError, "theta must be finite, got nan"),
        ({"mask": MASK, "rho_step": 0}, ValueError, "rho_step must be > 0, got 0"),
        ({"mask": MASK, "rho_step": -1}, ValueError, "rho_step must be > 0, got -1"),
        ({"mask": MASK, "rho_step": "a"}, TypeError, "rho_step must be a number, got 'a'"),
        (
            {"mask": MASK, "orientation": MASK.T},
            ValueError,
            "orientation must have shape (4, 5), got (5, 4)",
        ),
        ({"mask": MASK, "weights": [1]}, ValueError, "weights must have shape (4, 5), got (1,)"),
        (
            {"mask": MASK, "orientation": FLAT, "theta": [1, 0.5]},
            ValueError,
            "theta must ascend, over less than half a turn, where orientation is given, "
            "got 2 angles from 1 to 0.5",
        ),
        (
            {"mask": MASK, "orientation": FLAT, "orientation_tolerance": -0.1},
            ValueError,
            "orientation_tolerance must be >= 0 and finite, got -0.1",
        ),
        (
            {"points": [1, 2], "shape": (4, 5)},
            ValueError,
            "points must have shape (N, 2), got (2,)",
        ),
        (
            {"points": [[1, 2]], "shape": (4, 0)},
            ValueError,
            "shape must be in [1, 65536], got 0",
        ),
        (
            {"points": [[1, 2]], "shape": (4,)},
            ValueError,
            "shape must be a height and a width, got 1 numbers",
        ),
        (
            {"points": [[1, 2], [3, 4.6]], "shape": (4, 5)},
            ValueError,
            "points must lie within the image of shape (4, 5), got (3, 4.6)",
        ),
        (
            {"points": [[np.nan, 2]], "shape": (4, 5)},
            ValueError,
            "points must lie within the image of shape (4, 5), got (nan, 2)",
        ),
        (
            {"points": [[1, 2]], "shape": (4, 5), "orientation": [np.nan]},
            ValueError,
            "orientation must be finite at the points, got nan at point 0 of 1",
        ),
        (
            {"points": [[1, 2]], "shape": (4, 5), "weights": [-2]},
            ValueError,
            "weights must be >= 0 and finite at the points, got -2 at point 0 of 1",
        ),
        (
            {"points": [[1, 2]], "shape": (4, 5), "weights": [1e7]},
            ValueError,
            "weights must be small enough for votes below 2^31, got up to 1e+07",
        ),
        (
            {"mask": np.broadcast_to(np.uint8(0), (60000, 8000)), "rho_step": 0.01},
            ValueError,
            f"votes must have at most {MAX_ELEMENTS} elements, got 2179115820 in shape "
            "(12106199, 180), which would take 8716463280 bytes",
        ),
    ],
)
def test_hough_line(options, error, message):
    refused(error, message, cvkern.hough_line, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"slopes": [0, 1.5]},
            "slopes must be a list of numbers in [-1, 1], got shape (2,) with 0 to 1.5",
        ),
        (
            {"intercepts": [1]},
            "intercepts must be two or more, evenly spaced and ascending, got [1]",
        ),
        (
            {"intercepts": [1, 2, 4]},
            "intercepts must be two or more, evenly spaced and ascending, got [1, 2, 4]",
        ),
        (
            {"intercepts": [2, 1]},
            "intercepts must be two or more, evenly spaced and ascending, got [2, 1]",
        ),
    ],
)
def test_hough_line_slope(options, message):
    refused(ValueError, message, cvkern.hough_line_slope, MASK, **options)
    refused(
        ValueError,
        "mask must be 2-D, got shape (4, 5, 3)",
        cvkern.hough_line_slope,
        DEEP,
        **options,
    )


@pytest.mark.parametrize(
    ("given", "options", "error", "message"),
    [
        ((FLAT[0], [0], [0]), {}, ValueError, "hspace must be 2-D, got shape (5,)"),
        ((FLAT, [0], [0]), {}, ValueError, "angles must have shape (5,), got (1,)"),
        ((FLAT, range(5), range(3)), {}, ValueError, "dists must have shape (4,), got (3,)"),
        ((FLAT, range(5), range(4), -1), {}, ValueError, "min_distance must be in [0, 13], got -1"),
        (
            (FLAT, range(5), range(4), 1, 1.5),
            {},
            TypeError,
            "min_angle must be an integer, got 1.5",
        ),
        (
            (FLAT, range(5), range(4)),
            {"threshold": np.nan},
            ValueError,
            "threshold must be finite, got nan",
        ),
        (
            (FLAT, range(5), range(4)),
            {"num_peaks": 1.5},
            TypeError,
            "num_peaks must be an integer, got 1.5",
        ),
    ],
)
def test_hough_line_peaks(given, options, error, message):
    refused(error, message, cvkern.hough_line_peaks, *given, **options)


@pytest.mark.parametrize(
    ("lines", "options", "message"),
    [
        (([0], [0, 1]), {}, "theta and rho must be lists of one length, got shapes (1,) and (2,)"),
        (([np.inf], [0]), {}, "theta must be finite, got inf"),
        (([0], [np.nan]), {}, "rho must be finite, got nan"),
        (([0], [0]), {"min_length": -1}, "min_length must be >= 0 and finite, got -1"),
        (([0], [0]), {"max_gap": -1}, "max_gap must be >= 0 and finite, got -1"),
        (([0], [0]), {"distance": np.nan}, "distance must be >= 0 and finite, got nan"),
        (([0], [0]), {"orientation": [1]}, "orientation must have shape (4, 5), got (1,)"),
    ],
)
def test_hough_line_segments(lines, options, message):
    refused(ValueError, message, cvkern.hough_line_segments, MASK, *lines, **options)


@pytest.mark.parametrize(
    ("points", "weights", "message"),
    [
        ([1, 2], None, "points must have shape (N, 2), got (2,)"),
        ([[1, 2]], None, "points must be two or more, in different places, got fewer"),
        ([[1, 2], [1, 2]], None, "points must be two or more, in different places, got fewer"),
        (
            [[1, 2], [3, 4]],
            [1, 0],
            "points must be two or more, in different places, got fewer",
        ),
        ([[1, 2], [3, np.inf]], None, "points must be finite, got some that are not"),
        ([[1, 2], [3, 4]], [1], "weights must have shape (2,), got (1,)"),
        ([[1, 2], [3, 4]], [1, -3], "weights must be >= 0 and finite, got -3"),
    ],
)
def test_fit_line(points, weights, message):
    refused(ValueError, message, cvkern.fit_line, points, weights)


def test_detected_lines_and_segments():
    for function, name in (
        (cvkern.detect_lines, "min_votes"),
        (cvkern.detect_lines, "distance"),
        (cvkern.detect_segments, "min_length"),
        (cvkern.detect_segments, "distance"),
    ):
        refused(ValueError, f"{name} must be > 0, got 0", function, FLAT, **{name: 0})
    refused(
        ValueError, "max_gap must be >= 0 and finite, got -1", cvkern.detect_segments, FLAT,
        max_gap=-1,
    )  # fmt: skip
    strip = np.broadcast_to(np.uint8(0), (70000, 3))
    for function in (cvkern.detect_lines, cvkern.detect_segments):
        refused(ValueError, "image must be in [1, 65536], got 70000", function, strip)
        rule = "image must have shape (H, W) or (H, W, 3 or 4), got (4, 5, 2)"
        refused(ValueError, rule, function, DEEP[..., :2])
        refused(
            TypeError, "image must hold real numbers, got dtype complex128", function, FLAT * 1j
        )
        refused(ValueError, "sigma must be >= 0 and finite, got -1", function, FLAT, -1)


def test_suggested_bins():
    for options, message in (
        ({"localisation": 0}, "localisation must be > 0, got 0"),
        ({"length": 0}, "length must be > 0, got 0"),
        ({"shape": (0, 5)}, "shape must be in [1, 65536], got 0"),
    ):
        refused(ValueError, message, cvkern.suggest_line_bins, **({"shape": (4, 5)} | options))
