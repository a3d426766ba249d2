"""Stacks of images: equal to a loop over the images, in every bit."""

import numpy as np
import pytest

import cvkern

SHAPES = [(5, 40, 71), (3, 1, 1), (1, 33, 9), (2, 7, 200)]
GREY = {
    "gaussian": lambda x, **options: cvkern.gaussian(x, (1.5, 0.7), mode="nearest", **options),
    "derivative": lambda x, **options: cvkern.gaussian(x, 1.0, order=(0, 1), **options),
    "correlate_separable": lambda x, **options: cvkern.correlate_separable(
        x, ([1, -2, 0.5], [0.25, 3, 1]), mode="constant", cval=0.3, **options
    ),
    "box": lambda x, **options: cvkern.box(x, (1, 3), **options),
    "median": lambda x, **options: cvkern.median(x, 2, **options),
}
COLOUR = {
    "sobel": cvkern.sobel,
    "scharr": lambda x, **options: cvkern.scharr(x, axis=1, mode="wrap", **options),
    "prewitt": lambda x, **options: cvkern.prewitt(x, axis=0, **options),
    "gradient": lambda x, **options: np.stack(cvkern.gradient(x, sigma=1.3, **options), axis=-1),
    "gradient_sobel": lambda x, **options: np.stack(
        cvkern.gradient(x, sigma=0.8, operator="sobel", mode="constant", cval=0.4, **options),
        axis=-1,
    ),
}


def stack(shape, dtype):
    values = np.random.default_rng(0).random(shape)
    return (values * 255).astype(dtype)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", [*GREY, *COLOUR])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_grey_images(backend, name, shape, dtype):
    images = stack(shape, dtype)
    function = {**GREY, **COLOUR}[name]
    want = np.stack([function(image) for image in images])
    np.testing.assert_array_equal(function(images, batch_axis=0), want)


@pytest.mark.parametrize("name", GREY)
@pytest.mark.parametrize("axis", [1, 2, 3, -1])
def test_images_with_channels(backend, name, axis):
    images = np.ascontiguousarray(np.moveaxis(stack((3, 20, 33, 5), np.float32), -1, axis))
    one = axis - 1 if axis > 0 else -1
    want = np.stack([GREY[name](image, channel_axis=one) for image in images])
    got = GREY[name](images, channel_axis=axis, batch_axis=0)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("name", COLOUR)
@pytest.mark.parametrize("channels", [3, 4])
def test_colour_images(backend, name, channels):
    images = stack((3, 20, 71, channels), np.uint8)
    want = np.stack([COLOUR[name](image) for image in images])
    np.testing.assert_array_equal(COLOUR[name](images, batch_axis=0), want)


@pytest.mark.parametrize("dtype", [np.uint16, np.float64])
def test_a_median_of_a_stack_keeps_the_dtype(backend, dtype):
    images = stack((3, 12, 17), dtype)
    got = cvkern.median(images, batch_axis=0)
    assert got.dtype == dtype
    np.testing.assert_array_equal(got, np.stack([cvkern.median(image) for image in images]))


def test_a_stack_is_filled_in_place(backend):
    images, out = stack((3, 12, 17), np.float32), np.empty((3, 12, 17), np.float32)
    assert cvkern.gaussian(images, batch_axis=0, out=out) is out
    np.testing.assert_array_equal(out[1], cvkern.gaussian(images[1]))


def test_stacks_on_cuda(gpu):
    torch = pytest.importorskip("torch")
    for name, function in GREY.items():
        images = stack((5, 40, 71), np.float32)
        got = function(torch.from_numpy(images).cuda(), batch_axis=0).cpu().numpy()
        np.testing.assert_array_equal(got, function(images, batch_axis=0), err_msg=name)
    for shape in ((5, 40, 71), (5, 40, 71, 3)):
        images = stack(shape, np.float32)
        for got, want in zip(
            cvkern.gradient(torch.from_numpy(images).cuda(), batch_axis=0),
            cvkern.gradient(images, batch_axis=0),
            strict=True,
        ):
            np.testing.assert_array_equal(got.cpu().numpy(), want)
