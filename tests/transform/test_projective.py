"""Homographies, rotations, sizes and pyramids against SciPy, OpenCV, Pillow, scikit-image."""

import cv2
import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.data
import skimage.transform
from PIL import Image

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.calls import MODES, blobs, noise

TILTED = np.array([[0.9, 0.2, 3.0], [-0.1, 1.1, -2.0], [1e-3, -2e-3, 1.0]])


def seen_through(image, matrix, shape, order, mode, cval=0.0):
    """State the map in NumPy, sample with SciPy."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    u = np.linalg.inv(matrix) @ np.stack((x, y, np.ones_like(x))).reshape(3, -1)
    places = np.stack((u[1] / u[2], u[0] / u[2])).reshape(2, *shape)
    return ndi.map_coordinates(image.astype(float), places, order=order, mode=mode, cval=cval)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("order", [0, 1, 3])
def test_warp_perspective(backend, order, mode):
    image = noise(40, 30)
    got = cvkern.warp_perspective(image, TILTED, (37, 45), order=order, mode=mode, cval=0.25)
    want = seen_through(image, TILTED, (37, 45), order, mode, 0.25)
    # Weights round to 2^-24, from coordinates that are float64.
    np.testing.assert_allclose(got, want, rtol=0, atol=60 * 2**-24)


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_channels_are_seen_alike(backend, channels):
    """On the CPU, few channels are sampled otherwise than one, or many."""
    image = noise(channels * 60, 210).reshape(60, 210, channels)
    got = cvkern.warp_perspective(image, TILTED, channel_axis=-1)
    for c in range(channels):
        want = seen_through(image[..., c], TILTED, (60, 210), 1, "constant")
        # Weights and sums of float32, of values below 1.
        np.testing.assert_allclose(got[..., c], want, rtol=0, atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_bytes_are_rounded_means(backend, channels, mode):
    image = noise(60, 210 * channels, dtype="uint8").reshape(60, 210, channels)
    got = cvkern.warp_perspective(
        image, TILTED, (70, 203), channel_axis=-1, mode=mode, cval=7.0, dtype=np.uint8
    )
    for c in range(channels):
        want = seen_through(image[..., c], TILTED, (70, 203), 1, mode, 7.0)
        # Places are off by 2^-24 along each axis, and weights by 2^-23.
        sure = np.abs(want % 1 - 0.5) > 255 * 6 * 2.0**-24
        assert sure.mean() > 0.9
        np.testing.assert_array_equal(got[..., c][sure], np.floor(want + 0.5)[sure])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(61, 300), (3, 16), (2, 40), (1, 1), (9, 5, 3), (70, 190, 4)])
def test_bytes_are_the_same_in_both_sets(shape, mode):
    image = noise(shape[0], int(np.prod(shape[1:])), dtype="uint8").reshape(shape)
    axis = -1 if len(shape) == 3 else None
    turned = [[0.5, -0.9, 40.25], [0.8, 0.7, -3.5], [4e-3, 2e-3, 1.1]]
    for matrix in (TILTED, turned, 3 * np.eye(3), [[1, 0, 0], [0, 1, 0], [-0.02, 0, 1]]):
        found = []
        for name in KERNEL_SETS:
            with cvkern.use(backend=name):
                found.append(
                    cvkern.warp_perspective(
                        image, matrix, (50, 131), channel_axis=axis, mode=mode, dtype=np.uint8
                    )
                )
        np.testing.assert_array_equal(*found)
        if np.array_equal(matrix, 3 * np.eye(3)) and shape == (61, 300):
            np.testing.assert_array_equal(found[0], image[:50, :131])


def test_warp_perspective_is_opencvs(backend):
    """OpenCV rounds differently from release to release: within a grey value."""
    photo = skimage.data.camera()[::4, ::4]
    smooth = cv2.GaussianBlur(photo, (0, 0), 2.0)
    got = cvkern.warp_perspective(smooth, TILTED, dtype=np.uint8)
    want = cv2.warpPerspective(smooth, TILTED, smooth.shape[::-1])
    inner = cv2.warpPerspective(np.ones_like(smooth), TILTED, smooth.shape[::-1]) > 0
    inner = ndi.binary_erosion(inner, iterations=3)
    assert np.abs(got.astype(int) - want)[inner].max() <= 1


@pytest.mark.parametrize("order", [0, 1, 3])
def test_sets_give_the_same_bits(order):
    image = blobs(50, 60)
    found = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            real = cvkern.warp_perspective(image, TILTED, order=order, dtype=np.float32)
            byte = cvkern.warp_perspective(image, TILTED, order=order, dtype=np.uint8)
            small = cvkern.resize(image, (23, 31))
            found.append((real.view(np.uint32), byte, small.view(np.uint32)))
    for a, b in zip(*found, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("angle", [0, 30, 90, -135.5])
@pytest.mark.parametrize(("center", "resize"), [(None, False), (None, True), ((3.0, 12.5), False)])
def test_rotate_is_skimages(backend, angle, center, resize):
    image = noise(20, 33)
    other = None if center is None else center[::-1]
    got = cvkern.rotate(image, angle, resize=resize, center=center, mode="mirror")
    want = skimage.transform.rotate(
        image.astype(float), angle, resize=resize, center=other, mode="reflect"
    )
    assert got.shape == want.shape
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-5)  # its coordinates are rounded too


def test_rectify_plane(backend):
    photo = skimage.data.camera()[100:200, 100:220].astype(np.float32)
    corners = np.array([[10.5, 20.0], [14.0, 100.0], [80.0, 90.0], [75.0, 12.0]])
    got = cvkern.rectify_plane(photo, corners, (40, 50))
    target = np.array([[0, 0], [49, 0], [49, 39], [0, 39]], np.float32)
    matrix = cv2.getPerspectiveTransform(corners[:, ::-1].astype(np.float32), target)
    want = seen_through(photo, matrix, (40, 50), 1, "constant")
    # Each of some six operations rounds a value below 256 by 2^-17 at most; 2^-15 is measured.
    np.testing.assert_allclose(got, want, rtol=0, atol=2**-14)  # the corners are exact in float32
    for (y, x), (v, u) in zip(corners, [(0, 0), (0, 49), (39, 49), (39, 0)], strict=True):
        place = np.array([[[y]], [[x]]])
        assert abs(got[v, u] - cvkern.remap(photo, place)[0, 0]) < 1e-3


@pytest.mark.parametrize("shape", [(20, 30), (7, 11), (40, 61), (1, 1), (90, 7)])
def test_resize_is_pillows(backend, shape):
    image = noise(41, 60)
    got = cvkern.resize(image, shape)
    want = Image.fromarray(image).resize(shape[::-1], Image.Resampling.BILINEAR)
    np.testing.assert_allclose(got, np.asarray(want), rtol=0, atol=1e-6)


@pytest.mark.parametrize("shape", [(20, 30), (7, 11), (80, 121), (41, 60)])
def test_resize_is_opencvs(backend, shape):
    image = noise(41, 60, 3)
    got = cvkern.resize(image, shape, antialias=False, channel_axis=-1)
    want = cv2.resize(image, shape[::-1], interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-5)  # its weights are float32
    if shape[0] <= 41:
        got = cvkern.resize(image, shape, method="area", channel_axis=-1)
        want = cv2.resize(image, shape[::-1], interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-5)


@pytest.mark.parametrize("channels", [3, 300])
def test_resize_to_few_pixels(backend, channels):
    """Each pixel of the result reads many, or has many channels."""
    image = noise(30 * channels, 200).reshape(30, 200, channels)
    got = cvkern.resize(image, (2, 2), method="area", channel_axis=-1)
    want = image.astype(float).reshape(2, 15, 2, 100, channels).mean(axis=(1, 3))
    # Sums of 15 and of 100 positive numbers, each rounded: (15 + 100) 2^-24 at most.
    np.testing.assert_allclose(got, want, rtol=1e-5, atol=0)


@pytest.mark.parametrize("wide", [33, 100, 200])
def test_resize_ignores_pixels_without_weight(backend, wide):
    """On the CPU the ways for different widths read pixels whose weight is 0."""
    image = noise(6, 200)
    image[2, 7:] = np.inf
    got = cvkern.resize(image, (3, wide), antialias=False, method="area")
    assert np.isfinite(got[[0, 2]]).all()
    first = 7 * wide // 200  # the first pixel that covers a part of column 7
    np.testing.assert_array_equal(np.isfinite(got[1]), np.arange(wide) < first)


def test_resize_of_bytes(backend):
    image = noise(31, 40, dtype="uint8")
    real = cvkern.resize(image, (14, 25))
    byte = cvkern.resize(image, (14, 25), dtype=np.uint8)
    np.testing.assert_array_equal(byte, np.floor(real + np.float32(0.5)))
    planes = np.stack([image, 255 - image])
    both = cvkern.resize(planes, (14, 25), channel_axis=0)
    np.testing.assert_array_equal(both[0], real)


@pytest.mark.parametrize("name", ["pyramid_gaussian", "pyramid_laplacian"])
@pytest.mark.parametrize("shape", [(33, 47), (16, 16), (30, 21, 3)])
def test_pyramids_are_skimages(backend, name, shape):
    image = noise(*shape)
    axis = -1 if len(shape) == 3 else None
    got = getattr(cvkern, name)(image, channel_axis=axis)
    call = getattr(skimage.transform, name)
    want = list(call(image.astype(float), channel_axis=axis, preserve_range=True))
    assert len(got) == len(want)
    for ours, theirs in zip(got, want, strict=True):
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-6)
