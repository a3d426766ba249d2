"""Depth, points and clouds of disparities, against OpenCV and the equations in float64."""

import cv2
import numpy as np
import pytest
import skimage.data
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.test_equal_bits import assert_equal_bits

UNIT = 2.0**-24  # largest relative error of one rounding to float32
# The quarter-size motorcycle pair: pixels, millimetres, pixels.
FOCAL, BASELINE, DOFFS = 994.978, 193.001, 31.086
CX, CY = 311.193, 254.877
ODD = np.array([[0, -0.0, np.nan, np.inf, -np.inf, -5, -DOFFS, 7, 3e38, -3e38]], np.float32)


@pytest.fixture(scope="module")
def motorcycle():
    left, _, disparity = skimage.data.stereo_motorcycle()
    return left, disparity


def disparities(height, width, seed=0):
    values = np.random.default_rng(seed).uniform(-20, 200, (height, width)).astype(np.float32)
    values.flat[: ODD.size] = ODD.flat[: values.size]
    values[values == np.float32(-DOFFS)] = 1  # its point is at infinity, but for rounding
    return values


def matrix():
    return cvkern.reprojection_matrix(FOCAL, BASELINE, CX, CY, DOFFS)


def points_in_float64(disparity, q):
    """Return the points, and a bound of what float32 may be off."""
    y, x = np.indices(disparity.shape)
    terms = np.stack([x, y, disparity.astype(np.float64), np.ones(disparity.shape)], -1)
    mapped = terms @ q.T
    size = np.abs(terms) @ np.abs(q).T
    points = mapped[..., :3] / mapped[..., 3:]
    # Each of four products is of a rounded factor and is rounded, and so are three sums: less than
    # 8 units of the sum of their sizes, above and below; then the quotient.
    off = 8 * UNIT * (size[..., :3] + np.abs(points) * size[..., 3:]) / np.abs(mapped[..., 3:])
    return points, off + UNIT * np.abs(points)


def test_depth_of_the_motorcycle(backend, motorcycle):
    _, disparity = motorcycle
    depth = cvkern.disparity_to_depth(disparity, FOCAL, BASELINE, DOFFS)
    known = np.isfinite(disparity)
    assert 0.5 < known.mean() < 1
    np.testing.assert_array_equal(np.isnan(depth), ~known)
    want = 994.978 * 193.001 / (disparity[known].astype(np.float64) + 31.086)
    # The product and the offset are rounded, the sum and the quotient as well.
    np.testing.assert_allclose(depth[known], want, rtol=4 * UNIT)
    assert 2000 < depth[known].min() < depth[known].max() < 6000  # millimetres


def test_depth_where_there_is_none(backend):
    with np.errstate(over="ignore"):
        depth = cvkern.disparity_to_depth(ODD, FOCAL, BASELINE, DOFFS)[0]
    nan, inf = np.nan, np.inf
    far = np.float32(FOCAL * BASELINE / DOFFS)
    front = np.float32(FOCAL * BASELINE / (7 + DOFFS))
    want = [far, far, nan, nan, nan, FOCAL * BASELINE / (DOFFS - 5), inf, front, 0, nan]
    np.testing.assert_allclose(depth, want, rtol=4 * UNIT, atol=1e-33)
    assert not np.signbit(cvkern.disparity_to_depth([[0.0, -0.0]], 1, 1)).any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 70), (33, 1), (70, 129), (300, 500)])
def test_points(backend, shape):
    disparity, q = disparities(*shape), matrix()
    points = cvkern.points_from_disparity(disparity, q)
    assert points.shape == (*shape, 3)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        want, off = points_in_float64(disparity, q)
    exist = np.isfinite(disparity)
    np.testing.assert_array_equal(np.isnan(points).all(-1), ~exist)
    assert (np.abs(points - want) <= off)[exist].all()


def test_points_at_infinity(backend):
    q = cvkern.reprojection_matrix(2, 1, 0, 0)
    points = cvkern.points_from_disparity([[0.0, -0.0, 1.0]], q)
    np.testing.assert_array_equal(points, [[[np.nan] * 3, [np.nan] * 3, [2, 0, 2]]])


def test_points_of_any_matrix(backend):
    q = np.random.default_rng(1).normal(size=(4, 4))
    q[3] = 0.01, -0.02, 0.5, 7  # the last coordinate of a projective map, apart from 0
    disparity = np.abs(disparities(40, 50, seed=2))
    disparity[~np.isfinite(disparity) | (disparity > 1e3)] = 1
    points = cvkern.points_from_disparity(disparity, q)
    want, off = points_in_float64(disparity, q)
    assert (np.abs(points - want) <= off).all()


def test_points_are_those_of_opencv(backend, motorcycle):
    _, disparity = motorcycle
    known = np.isfinite(disparity)
    points = cvkern.points_from_disparity(disparity, matrix())
    theirs = cv2.reprojectImageTo3D(disparity, matrix())
    off = points_in_float64(np.where(known, disparity, 1), matrix())[1]
    assert (np.abs(points - theirs) <= 2 * off)[known].all()
    depth = cvkern.disparity_to_depth(disparity, FOCAL, BASELINE, DOFFS)
    np.testing.assert_allclose(points[known][:, 2], depth[known], rtol=16 * UNIT)


def test_reprojection_matrix_is_that_of_opencv():
    camera = np.array([[FOCAL, 0, CX], [0, FOCAL, CY], [0, 0, 1]])
    none, shift = np.zeros(5), np.array([[-BASELINE], [0], [0]])
    rectified = cv2.stereoRectify(camera, none, camera, none, (741, 500), np.eye(3), shift, flags=0)
    left, right, q = rectified[2:5]
    doffs = right[0, 2] - left[0, 2]
    ours = cvkern.reprojection_matrix(left[0, 0], BASELINE, left[0, 2], left[1, 2], doffs)
    np.testing.assert_allclose(ours, q, atol=1e-9)
    assert matrix()[3, 3] == DOFFS / BASELINE


@pytest.mark.parametrize("channels", [None, 3])
def test_clouds(backend, channels):
    rng = np.random.default_rng(3)
    disparity, q = disparities(90, 131), matrix()
    image = rng.integers(0, 256, (90, 131, channels or 1), np.uint8)
    valid = rng.random((90, 131)) < 0.7
    points = cvkern.points_from_disparity(disparity, q)
    colors = np.broadcast_to(image, (90, 131, 3))
    given = image if channels else image[..., 0]
    for mask in (None, valid, np.zeros_like(valid)):
        kept = np.isfinite(points).all(-1) & (True if mask is None else mask)
        cloud = cvkern.point_cloud(disparity, q, given, mask)
        np.testing.assert_array_equal(cloud.points, points[kept])
        np.testing.assert_array_equal(cloud.colors, colors[kept])
        assert cloud.points.dtype == np.float32
        assert cloud.colors.dtype == np.uint8


def test_tensors_come_back_as_tensors(backend):
    torch = pytest.importorskip("torch")
    disparity = disparities(6, 7)
    image, valid = np.full((6, 7), 9, np.uint8), disparity > 0
    tensors = [torch.from_numpy(a) for a in (disparity, image, valid)]
    cloud = cvkern.point_cloud(tensors[0], matrix(), *tensors[1:])
    want = cvkern.point_cloud(disparity, matrix(), image, valid)
    for ours, theirs in zip(cloud, want, strict=True):
        assert isinstance(ours, torch.Tensor)
        np.testing.assert_array_equal(ours.numpy(), theirs)


@given(st.tuples(st.integers(1, 40), st.integers(1, 70)), st.integers(0, 2**16))
def test_equal_bits(shape, seed):
    disparity = disparities(*shape, seed=seed)
    image = np.random.default_rng(seed).integers(0, 256, (*shape, 3), np.uint8)
    q = matrix() + np.random.default_rng(seed).normal(size=(4, 4))
    for k in (0.0, DOFFS):
        assert_equal_bits(lambda: cvkern.disparity_to_depth(disparity, FOCAL, BASELINE, k))  # noqa: B023
    assert_equal_bits(lambda: cvkern.points_from_disparity(disparity, q))
    assert_equal_bits(lambda: cvkern.point_cloud(disparity, q, image, disparity > 20))
