"""Colour images: the longest of the channels' gradients, as in cv2.Canny, and alpha ignored."""

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.kernels.codes.edges import Norm
from tests.primitives import F32

PHOTO = skimage.data.astronaut()[60:150, 150:271]


def longest(channels, dy, dx, squared):
    """Take fields (3, H, W) from the channel of the longest gradient, the first of equal ones."""
    lengths = dx * dx + dy * dy if squared else np.abs(dx) + np.abs(dy)
    return np.take_along_axis(channels, lengths.argmax(axis=0)[None], axis=0)[0]


@pytest.mark.parametrize("operator", ["gaussian", "sobel"])
@pytest.mark.parametrize("dtype", [np.uint8, np.float64])
def test_a_gradient_is_that_of_the_strongest_channel(backend, operator, dtype):
    photo = PHOTO.astype(dtype)
    found = cvkern.gradient(photo, sigma=1.5, operator=operator, mode="nearest")
    alone = [
        cvkern.gradient(photo[..., c], sigma=1.5, operator=operator, mode="nearest")
        for c in range(3)
    ]
    fields = [np.stack(field) for field in zip(*alone, strict=True)]
    for got, channels in zip(found, fields, strict=True):
        np.testing.assert_array_equal(got, longest(channels, *fields[:2], squared=True))
    shares = np.mean(found.dx == fields[1][0]), np.mean(found.dx == fields[1][2])
    assert min(shares) > 0.1  # several channels lead somewhere


@pytest.mark.parametrize("function", [cvkern.sobel, cvkern.scharr])
def test_edge_strength_is_that_of_the_strongest_channel(backend, function):
    alone = np.stack([function(PHOTO[..., c]) for c in range(3)])
    np.testing.assert_array_equal(function(PHOTO), alone.max(axis=0))
    dy, dx = (np.stack([function(PHOTO[..., c], axis=a) for c in range(3)]) for a in (0, 1))
    np.testing.assert_array_equal(function(PHOTO, axis=0), longest(dy, dy, dx, squared=True))
    np.testing.assert_array_equal(function(PHOTO, axis=1), longest(dx, dy, dx, squared=True))


def test_alpha_is_ignored_and_equal_channels_are_grey(backend):
    alpha = np.random.default_rng(0).integers(0, 256, PHOTO.shape[:2]).astype(np.uint8)
    grey = np.repeat(PHOTO[..., :1], 3, axis=2)
    for function in (cvkern.gradient, cvkern.sobel, cvkern.canny):
        for one, other in (
            (PHOTO, np.dstack([PHOTO, alpha])),
            (grey[..., 0], grey),
        ):
            np.testing.assert_array_equal(function(one), function(other))


@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 200, 4), (70, 1, 3), (5, 6, 4)])
def test_any_shape(backend, shape):
    image = np.random.default_rng(0).random(shape).astype(F32)
    found = cvkern.gradient(image, operator="sobel", sigma=0)
    alone = [cvkern.gradient(image[..., c], operator="sobel", sigma=0) for c in range(3)]
    dy, dx = (np.stack([getattr(g, name) for g in alone]) for name in ("dy", "dx"))
    np.testing.assert_array_equal(found.dy, longest(dy, dy, dx, squared=True))


@pytest.mark.parametrize("norm", list(Norm))
def test_longest_of_equal_ones_is_the_first(kernels, norm):
    rng = np.random.default_rng(1)
    dys, dxs = rng.integers(-2, 3, (2, 3, 40, 70)).astype(F32)  # with many ties
    dy, dx = kernels(
        "filters.channels.longest", dys, dxs, int(norm), out=[((40, 70), F32), ((40, 70), F32)]
    )
    np.testing.assert_array_equal(dy, longest(dys, dys, dxs, norm == Norm.L2))
    np.testing.assert_array_equal(dx, longest(dxs, dys, dxs, norm == Norm.L2))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_split(kernels, dtype):
    image = np.random.default_rng(2).integers(0, 256, (33, 65, 4)).astype(dtype)
    planes = kernels("filters.channels.split", image, out=[((3, 33, 65), dtype)])
    np.testing.assert_array_equal(planes, np.moveaxis(image[..., :3], 2, 0))
