"""Every error of depth and clouds."""

from functools import partial

import numpy as np
import pytest

import cvkern
from cvkern import clouds
from tests.refusals import DEEP, FLAT, refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

# --- depth ---------------------------------------------------------------------------------------

Q = np.eye(4)


def test_disparity_maps():
    gray = np.zeros((4, 5), np.uint8)
    for call in (
        lambda x: cvkern.disparity_to_depth(x, 1, 1),
        lambda x: cvkern.points_from_disparity(x, Q),
        lambda x: cvkern.point_cloud(x, Q, gray),
    ):
        refused(ValueError, "disparity must be 2-D, got shape (4, 5, 3)", call, DEEP)
        refused(ValueError, "disparity must not be empty, got shape (0, 5)", call, np.zeros((0, 5)))
        refused(
            TypeError, "disparity must hold real numbers, got dtype complex128", call, FLAT + 0j
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"focal": 0}, "focal must be > 0, got 0"),
        ({"focal": -3.5}, "focal must be > 0, got -3.5"),
        ({"focal": np.nan}, "focal must be finite, got nan"),
        ({"baseline": 0.0}, "baseline must be > 0, got 0.0"),
        ({"baseline": np.inf}, "baseline must be finite, got inf"),
        ({"doffs": -np.inf}, "doffs must be finite, got -inf"),
    ],
)
def test_cameras(options, message):
    camera = {"focal": 1.0, "baseline": 1.0} | options
    refused(ValueError, message, cvkern.disparity_to_depth, FLAT, **camera)
    refused(ValueError, message, cvkern.reprojection_matrix, cx=0, cy=0, **camera)


def test_numbers_of_cameras():
    message = "focal times baseline must be finite, got 1e+40"
    refused(ValueError, message, cvkern.disparity_to_depth, FLAT, 1e20, 1e20)
    refused(TypeError, "focal must be a number, got 'a'", cvkern.disparity_to_depth, FLAT, "a", 1)
    for name, values in (("cx", (np.nan, 0)), ("cy", (0, np.nan))):
        message = f"{name} must be finite, got nan"
        refused(ValueError, message, cvkern.reprojection_matrix, 1, 1, *values)


def test_disparities_of_too_many_points():
    large = np.broadcast_to(np.float32(1), (2**14, 2**14))
    message = "disparity must have at most 178956970 elements, got shape (16384, 16384)"
    refused(ValueError, message, cvkern.points_from_disparity, large, Q)
    refused(ValueError, message, cvkern.point_cloud, large, Q, FLAT)


@pytest.mark.parametrize("name", ["points_from_disparity", "point_cloud"])
def test_reprojection(name):
    function, rest = getattr(cvkern, name), (FLAT,) * (name == "point_cloud")
    rule = "q must be a 4 x 4 matrix of numbers"
    for q, said in (
        (np.eye(3), "float64 of shape (3, 3)"),
        (None, "object of shape ()"),
        (Q + 0j, "complex128 of shape (4, 4)"),
    ):
        refused(ValueError, f"{rule}, got {said}", function, FLAT, q, *rest)
    for value in (np.nan, np.inf, 1e300):
        said = "nan" if np.isnan(value) else "inf"
        refused(
            ValueError,
            f"q must be finite, got {said}",
            function,
            FLAT,
            np.full((4, 4), value),
            *rest,
        )


def test_images_of_clouds():
    for shape in ((4, 4), (5, 5, 3), (4, 5, 4), (4, 5, 1)):
        message = f"image must have shape (4, 5) or (4, 5, 3), as the disparity, got {shape}"
        refused(ValueError, message, cvkern.point_cloud, FLAT, Q, np.zeros(shape, np.uint8))
    refused(TypeError, "image must be uint8, got float64", cvkern.point_cloud, FLAT, Q, DEEP)
    gray = np.zeros((4, 5), np.uint8)
    refused(TypeError, "valid must be bool, got uint8", cvkern.point_cloud, FLAT, Q, gray, gray)
    message = "valid must have shape (4, 5), as the disparity, got (5, 4)"
    refused(ValueError, message, cvkern.point_cloud, FLAT, Q, gray, np.ones((5, 4), bool))


# --- clouds --------------------------------------------------------------------------------------

CLOUD = np.ones((4, 3))


@pytest.mark.parametrize("function", [clouds.turntable, partial(clouds.write_ply, "a.ply")])
def test_clouds(function):
    tints = np.zeros((4, 3), np.uint8)
    for shape in ((4, 2), (3, 4)):
        message = f"points must have shape (N, 3), got {shape}"
        refused(ValueError, message, function, np.ones(shape), tints)
    message = "points must not be empty, got shape (0, 3)"
    refused(ValueError, message, function, np.ones((0, 3)), tints)
    refused(ValueError, "points must be 2-D, got shape (4, 5, 3)", function, DEEP, tints)
    refused(
        TypeError,
        "points must hold real numbers, got dtype complex128",
        function,
        1j * CLOUD,
        tints,
    )
    for value in (np.nan, np.inf, 1e300):
        said = "nan" if np.isnan(value) else "inf"
        message = f"points must be finite, got {said}"
        refused(ValueError, message, function, np.full((4, 3), value), tints)
    message = "colors must have shape (4, 3), as the points, got (3, 3)"
    refused(ValueError, message, function, CLOUD, tints[1:])
    refused(TypeError, "colors must be uint8, got float64", function, CLOUD, CLOUD)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"swing": 0}, "swing must lie in (0, 180], got 0"),
        ({"swing": -1}, "swing must lie in (0, 180], got -1"),
        ({"swing": 181.0}, "swing must lie in (0, 180], got 181"),
        ({"frames": 0}, "frames must be in [1, 4096], got 0"),
        ({"shape": (0, 5)}, "shape must be in [1, 8192], got 0"),
        ({"shape": (5, 10**6)}, "shape must be in [1, 8192], got 1000000"),
        ({"shape": 5}, "shape must be rows and columns, got 5"),
        ({"point_size": 0}, "point_size must be > 0, got 0"),
        (
            {"background": (0, 0)},
            "background must be red, green and blue in [0, 255], got (0, 0)",
        ),
    ],
)
def test_turntable(options, message):
    tints = np.zeros((4, 3), np.uint8)
    refused(ValueError, message, clouds.turntable, CLOUD, tints, **options)


def test_clouds_behind_the_camera():
    message = "points must lie in front of the camera, got 4 behind it"
    refused(ValueError, message, clouds.turntable, -CLOUD, np.zeros((4, 3), np.uint8))


def test_files_of_clouds():
    refused(ValueError, "path must end in .ply, got 'a.txt'", clouds.write_ply, "a.txt", CLOUD)
    frames = np.zeros((2, 4, 6, 3), np.uint8)
    write = clouds.write_animation
    refused(ValueError, "path must end in .gif or .mp4, got 'a.avi'", write, "a.avi", frames)
    message = "frames must be uint8 of shape (F, H, W, 3), got float64 of shape (4, 5, 3)"
    refused(ValueError, message, write, "a.gif", DEEP)
    refused(ValueError, "fps must be > 0, got 0", write, "a.gif", frames, fps=0)
    refused(
        ValueError, "fps must be in [0.0016, 50] for .gif, got 60", write, "a.gif", frames, fps=60
    )
    message = "frames must have an even height and width for .mp4, got shape (2, 4, 5, 3)"
    refused(ValueError, message, write, "a.mp4", frames[:, :, 1:])
