"""Every error of the Hough family."""

from typing import Any

import numpy as np
import pytest
from refusals import DEEP, FLAT, HUGE, no_kernel_runs, refused  # noqa: F401

import cvkern
from cvkern._validate import MAX_ELEMENTS

# --- shapes --------------------------------------------------------------------------------------

TABLE = cvkern.RTable(np.ones((3, 2)), np.zeros(3), np.zeros(2), (4, 5))


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("template", cvkern.r_table),
        ("image", lambda x: cvkern.generalized_hough(x, TABLE)),
        ("image", lambda x: cvkern.generalized_hough_votes(x, TABLE)),
        ("template", lambda x: cvkern.find_shape(x, FLAT)),
    ],
)
def test_images_of_shapes(name, function):
    refused(ValueError, f"{name} must be 2-D, got shape (4, 5, 3)", function, DEEP)
    refused(ValueError, f"{name} must not be empty, got shape (0, 5)", function, np.zeros((0, 5)))
    message = f"{name} must hold real numbers, got dtype complex128"
    refused(TypeError, message, function, FLAT.astype(complex))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"rotations": 0}, ValueError, "rotations must be in [1, 16384], got 0"),
        ({"rotations": []}, ValueError, "rotations must be 1-D and not empty, got shape (0,)"),
        (
            {"rotations": [[1.0]]},
            ValueError,
            "rotations must be 1-D and not empty, got shape (1, 1)",
        ),
        ({"rotations": [0, np.nan]}, ValueError, "rotations must be in [-100, 100], got nan"),
        ({"rotations": "all"}, TypeError, "rotations must be numbers, got 'all'"),
        ({"scales": [1, 0.01]}, ValueError, "scales must be in [0.0625, 16], got 0.01"),
        ({"scales": [np.inf]}, ValueError, "scales must be in [0.0625, 16], got inf"),
        ({"scales": 1.5}, ValueError, "scales must be 1-D and not empty, got shape ()"),
        ({"cell": 3}, ValueError, "cell must be one of (1, 2, 4, 8, 16), got 3"),
        ({"max_entries": 0}, ValueError, "max_entries must be in [1, 1048576], got 0"),
        (
            {"orientation_tolerance": -0.1},
            ValueError,
            "orientation_tolerance must be >= 0 and finite, got -0.1",
        ),
        (
            {"orientation": np.zeros((5, 4))},
            ValueError,
            "orientation must have the shape of the image, (4, 5), got (5, 4)",
        ),
        ({"orientation": DEEP}, ValueError, "orientation must be 2-D, got shape (4, 5, 3)"),
        ({"sigma": -1}, ValueError, "sigma must be >= 0 and finite, got -1"),
        (
            {"low_threshold": 5, "high_threshold": 2.5},
            ValueError,
            "low_threshold must be <= high_threshold, got 5 > 2.5",
        ),
    ],
)
def test_options_of_votes(options, error, message):
    for function in (cvkern.generalized_hough, cvkern.generalized_hough_votes):
        refused(error, message, function, FLAT, TABLE, **options)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"threshold": -1}, ValueError, "threshold must be >= 0 and finite, got -1"),
        ({"num_peaks": 0}, ValueError, "num_peaks must be in [1, 1000000], got 0"),
        ({"num_peaks": 1.5}, TypeError, "num_peaks must be an integer, got 1.5"),
        ({"min_distance": -2}, ValueError, "min_distance must be >= 0 and finite, got -2"),
        ({"min_rotation": np.nan}, ValueError, "min_rotation must be >= 0 and finite, got nan"),
        ({"min_ratio": 0.5}, ValueError, "min_ratio must be >= 1 and finite, got 0.5"),
        (
            {"max_bytes": 11},
            ValueError,
            "max_bytes must be at least 12, what one rotation and scale takes, got 11",
        ),
    ],
)
def test_options_of_shapes(options, error, message):
    refused(error, message, cvkern.generalized_hough, FLAT, TABLE, **options)


def test_tables():
    for table, shapes in (
        (TABLE._replace(vectors=np.ones((0, 2)), orientation=np.ones(0)), "(0, 2) and (0,)"),
        (TABLE._replace(vectors=np.ones((3, 3))), "(3, 3) and (3,)"),
        (TABLE._replace(orientation=np.zeros(2)), "(3, 2) and (2,)"),
    ):
        message = (
            "table must have vectors of shape (N, 2) and orientation of shape (N,), N >= 1, "
            f"got {shapes}"
        )
        refused(ValueError, message, cvkern.generalized_hough, FLAT, table)
    for wrong in (
        TABLE._replace(vectors=np.full((3, 2), np.nan)),
        TABLE._replace(vectors=np.full((3, 2), 5000.0)),
        TABLE._replace(orientation=np.full(3, np.nan)),
    ):
        message = (
            "table must have vectors of at most 4096 pixels and angles within -7 to 7, got others"
        )
        refused(ValueError, message, cvkern.generalized_hough_votes, FLAT, wrong)
    wrong_type: Any = (np.ones((3, 2)), np.zeros(3))
    message = "table must be an RTable, got tuple"
    refused(TypeError, message, cvkern.generalized_hough, FLAT, wrong_type)


def test_accumulators_of_shapes_too_large():
    image = np.broadcast_to(np.uint8(0), (4000, 4000))
    message = (
        f"accumulator must have at most {MAX_ELEMENTS} elements, "
        "got shape (360, 17, 1000, 1000): 24480000000 bytes"
    )
    options = {"rotations": 360, "scales": np.linspace(0.8, 1.6, 17)}
    refused(ValueError, message, cvkern.generalized_hough_votes, image, TABLE, **options)


@pytest.mark.parametrize("reference", [(1,), 5, (1, 2, 3), (np.nan, 1)])
def test_references(reference):
    message = f"reference must be two finite numbers, got {reference!r}"
    refused(ValueError, message, cvkern.r_table, FLAT, reference=reference)
    refused(TypeError, "reference must be numbers, got 'a'", cvkern.r_table, FLAT, reference="a")


def test_orientation_of_pictures():
    message = "find_shape takes pictures, got orientation: use generalized_hough"
    refused(TypeError, message, cvkern.find_shape, FLAT, FLAT, orientation=FLAT)


# --- lines ---------------------------------------------------------------------------------------

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
        refused(ValueError, "image must be 2-D, got shape (4, 5, 3)", function, DEEP)
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


# --- circles and ellipses ------------------------------------------------------------------------

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
    refused(ValueError, f"{what} must be 2-D, got shape (4, 5, 3)", function, DEEP)
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
    ({"radii": [2]}, ValueError, "radii must be one of each of 2 accumulators, got 1"),
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
