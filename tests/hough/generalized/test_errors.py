"""Every error of the search for shapes."""

from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern._checks import MAX_ELEMENTS
from tests.refusals import DEEP, FLAT, refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

TABLE = cvkern.RTable(np.ones((3, 2)), np.zeros(3), np.zeros(2), (4, 5))


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("template", cvkern.r_table),
        ("image", lambda x: cvkern.generalized_hough(x, TABLE)),
        ("image", lambda x: cvkern.generalized_hough_votes(x, TABLE)),
        ("template", lambda x: cvkern.detect_shape(x, FLAT)),
    ],
)
def test_images_of_shapes(name, function):
    rule = f"{name} must have shape (H, W) or (H, W, 3 or 4), got (4, 5, 2)"
    refused(ValueError, rule, function, DEEP[..., :2])
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
        ({"rotations": "all"}, TypeError, "rotations must be real numbers, got 'all'"),
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
            "max_bytes must be at least 12, for one rotation and scale, got 11",
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
    message = "detect_shape takes pictures, got orientation: use generalized_hough"
    refused(TypeError, message, cvkern.detect_shape, FLAT, FLAT, orientation=FLAT)
