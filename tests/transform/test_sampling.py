"""Sampling at coordinates against SciPy, its gradients against differences."""

import itertools

import numpy as np
import pytest
import scipy.ndimage as ndi

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.calls import MODES, noise

ORDERS = [0, 1, 3]
SHAPES = [(16, 21), (12, 13), (60, 70)]


def places(height, width, shape=(11, 17), seed=0, reach=2.0):
    """Return coordinates in and round an image, some of them whole or half."""
    rng = np.random.default_rng(seed)
    found = np.stack(
        [rng.uniform(-reach * n, (1 + reach) * n, shape) for n in (height, width)]
    ).astype(np.float32)
    found[:, :3] = np.round(found[:, :3] * 2) / 2
    return found


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("shape", SHAPES)
def test_remap_is_scipys(backend, shape, order, mode):
    image = noise(*shape) * 200
    where = places(*shape)
    got = cvkern.remap(image, where, order, mode=mode, cval=7)
    wide = where.astype(float)
    want = ndi.map_coordinates(image.astype(float), wide, order=order, mode=mode, cval=7)
    assert got.dtype == np.float32
    # Weights and coefficients are rounded to 2^-24; a spline of [0, 200] reaches to about 600.
    np.testing.assert_allclose(got, want, rtol=0, atol=600 * 20 * 2**-24)


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(1, 5), (4, 1), (2, 3), (1, 1)])
def test_small_images(backend, shape, order, mode):
    image, where = noise(*shape), places(*shape, reach=3.0)
    got = cvkern.remap(image, where, order, mode=mode, cval=0.5)
    wide = where.astype(float)
    want = ndi.map_coordinates(image.astype(float), wide, order=order, mode=mode, cval=0.5)
    np.testing.assert_allclose(got, want, rtol=0, atol=4 * 2**-24)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(1, 5), (2, 3), (4, 4), (100, 7)])
def test_a_spline_goes_through_the_pixels(backend, shape, mode):
    """In mode 'reflect' SciPy's does so only from about ten pixels a side on."""
    image = noise(*shape)
    grid = np.indices(shape).astype(np.float32)
    got = cvkern.remap(image, grid, 3, mode=mode)
    if mode == "wrap":  # the last pixel is the first one
        got, image = got[:-1, :-1], image[:-1, :-1]
    np.testing.assert_allclose(got, image, rtol=0, atol=20 * 2**-24)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("axis", [0, 2, -1])
def test_channels(backend, order, axis):
    image, where = noise(14, 15, 3), places(14, 15)
    got = cvkern.remap(np.moveaxis(image, 2, axis), where, order, channel_axis=axis)
    for c in range(3):
        alone = cvkern.remap(image[..., c], where, order)
        np.testing.assert_array_equal(np.moveaxis(got, axis, 2)[..., c], alone)


@pytest.mark.parametrize("order", ORDERS)
def test_bytes(backend, order):
    image, where = noise(30, 20, dtype="uint8"), places(30, 20, reach=0.2)
    real = cvkern.remap(image.astype(np.float32), where, order, mode="mirror")
    same = cvkern.remap(image, where, order, mode="mirror", dtype=np.float32)
    np.testing.assert_array_equal(same, real)
    byte = cvkern.remap(image, where, order, mode="mirror", dtype=np.uint8)
    np.testing.assert_array_equal(byte, np.floor(real.clip(0, 255) + np.float32(0.5)))
    assert cvkern.remap(image, where, 0).dtype == np.uint8
    assert cvkern.remap(image, where, 1).dtype == np.float32


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("scalar", ["uint8", "float32"])
def test_bytes_of_few_channels(backend, scalar, channels):
    """On the CPU, linear samples of few channels inside the image are made 16 at a time."""
    image = noise(30, 40 * channels, dtype="uint8").reshape(30, 40, channels).astype(scalar)
    where = places(30, 40, (5, 150), reach=0.1)
    got = cvkern.remap(image, where, mode="nearest", channel_axis=-1, dtype=np.uint8)
    layers = [ndi.map_coordinates(image[..., c].astype(float), where.astype(float), order=1,
                                  mode="nearest") for c in range(channels)]  # fmt: skip
    want = np.stack(layers, axis=-1)
    # Half a step of rounding, and three roundings of float32 of at most 255.
    np.testing.assert_allclose(got, want, rtol=0, atol=0.5 + 3 * 2**-16)


def test_what_is_no_place_is_outside(backend):
    image = np.ones((3, 3))
    where = np.full((2, 1, 3), np.nan, np.float32)
    where[:, 0, 1], where[:, 0, 2] = np.inf, 1.0
    for mode in MODES:
        assert cvkern.remap(image, where, mode=mode, cval=5).tolist() == [[5, 5, 1]]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("mode", MODES)
def test_sets_give_the_same_bits(order, mode):
    image, where = noise(40, 33) - np.float32(0.5), places(40, 33)
    found = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            found.append(cvkern.remap(image, where, order, mode=mode).view(np.uint32))
    np.testing.assert_array_equal(*found)


# --------------------------------------------------------------------------------- gradients


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("shape", [(12, 14), (2, 13), (1, 12)])
def test_dot_product(backend, shape, order, mode):
    """<J v, u> = <v, J^T u>: `remap` is linear in the image."""
    where = places(*shape, reach=1.0)
    v, u = noise(*shape, seed=1), noise(*where.shape[1:], seed=2)
    there = (cvkern.remap(v, where, order, mode=mode).astype(float) * u).sum()
    back = cvkern.remap_backward(u, v, where, order, mode=mode).image
    # 187 products near 1, each within some 2^-22.
    assert abs(there - (v.astype(float) * back).sum()) <= 187 * 2**-20


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("order", ORDERS)
def test_gradients_by_coordinates_are_differences(backend, order, mode):
    image = noise(15, 16).astype(float)
    where = places(15, 16, reach=0.9, seed=3)
    step = 1e-3
    # Away from the ends of the pieces, where there is no derivative.
    off = (where * 2) % 1
    where = np.where((off < 0.05) | (off > 0.95), where + np.float32(0.1), where)
    found = cvkern.remap_backward(np.ones(where.shape[1:]), image, where, order, mode=mode)
    for axis in (0, 1):
        ends = []
        for side in (-1, 1):
            moved = where.astype(float)
            moved[axis] += side * step
            ends.append(ndi.map_coordinates(image, moved, order=order, mode=mode))
        want = (ends[1] - ends[0]) / (2 * step)
        # Third derivatives of the spline are below 60: the difference is within 1e-5.
        np.testing.assert_allclose(found.coordinates[axis], want, rtol=0, atol=1e-4)


@pytest.mark.parametrize("order", [0, 1, 3])
def test_gradients_by_the_image_are_differences(backend, order):
    image, where = noise(12, 13), places(12, 13, (4, 5), reach=0.2)
    grad = noise(4, 5, seed=5)
    found = cvkern.remap_backward(grad, image, where, order, mode="reflect").image
    for y, x in itertools.product((0, 5, 11), (0, 3, 12)):
        unit = np.zeros(image.shape)
        unit[y, x] = 1.0
        response = ndi.map_coordinates(unit, where.astype(float), order=order, mode="reflect")
        np.testing.assert_allclose(found[y, x], (response * grad).sum(), rtol=0, atol=1e-5)


def test_gradients_of_channels(backend):
    image, where, grad = noise(9, 8, 2), places(9, 8), noise(11, 17, 2, seed=1)
    both = cvkern.remap_backward(grad, image, where, channel_axis=-1)
    ones = [cvkern.remap_backward(grad[..., c], image[..., c], where) for c in range(2)]
    for c in range(2):
        np.testing.assert_array_equal(both.image[..., c], ones[c].image)
    total = ones[0].coordinates.astype(float) + ones[1].coordinates
    np.testing.assert_allclose(both.coordinates, total, rtol=0, atol=1e-5)
