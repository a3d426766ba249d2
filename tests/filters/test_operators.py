"""Operators of 3 x 3 pixels against scikit-image."""

import numpy as np
import pytest
import skimage.filters

import cvkern
from tests.calls import DTYPES, MODES, noise
from tests.reference_rounding import U, separable_error

SHAPES = [(1, 1), (1, 40), (37, 1), (2, 2), (33, 70)]
SMOOTH = {"sobel": [1, 2, 1], "scharr": [3, 10, 3], "prewitt": [1, 1, 1]}
BEND = [-1, 2, -1]
NAMES = [*SMOOTH, "laplace", "sobel_h", "sobel_v"]
PADDINGS = {
    "reflect": {"mode": "symmetric"},
    "constant": {"mode": "constant", "constant_values": 0.7},
    "nearest": {"mode": "edge"},
    "mirror": {"mode": "reflect"},
    "wrap": {"mode": "wrap"},
}


def error(name, image, cval=0.0):
    """Return how far float32 may move the operator's result."""
    if name == "laplace":
        return 2 * separable_error(image, BEND, cval=cval) + 8 * U * max(np.abs(image).max(), cval)
    smooth = np.array(SMOOTH[name[:5] if name[:5] == "sobel" else name])
    # The root mean square of two derivatives moves as far as they do, but for its own rounding.
    most = max(np.abs(image).max(), cval)
    return separable_error(image, smooth / smooth.sum(), [-1, 0, 1], cval=cval) + 8 * U * most


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", SMOOTH)
def test_edge_strength_is_scikit_images(backend, name, mode):
    oracle = getattr(skimage.filters, name)
    for shape in SHAPES:
        image = noise(*shape)
        for axis in (None, 0, 1):
            got = getattr(cvkern, name)(image, axis=axis, mode=mode, cval=0.7)
            if mode == "constant":  # scikit-image before 0.26 does not pass cval on
                padded = np.pad(image.astype(float), 1, constant_values=0.7)
                want = oracle(padded, axis=axis)[1:-1, 1:-1]
            else:
                want = oracle(image.astype(float), axis=axis, mode=mode)
            assert got.dtype == np.float32
            np.testing.assert_allclose(got, want, rtol=0, atol=error(name, image, 0.7))


@pytest.mark.parametrize("name", NAMES)
def test_integers_are_not_rescaled(backend, name):
    for dtype in DTYPES:
        image = noise(9, 14, dtype=dtype)
        if image.dtype.itemsize == 8 and image.dtype.kind != "f":
            image = image // 8  # squares of derivatives above 1.8e19 are beyond float32
        got = getattr(cvkern, name)(image)
        want = getattr(skimage.filters, name)(image.astype(float))
        np.testing.assert_allclose(got, want, rtol=0, atol=error(name, image.astype(float)))


@pytest.mark.parametrize("mode", MODES)
def test_laplace_continues_the_image_by_its_mode(backend, mode):
    for shape in ((2, 2), (33, 70), (5, 3)):
        image = noise(*shape)
        padded = np.pad(image.astype(float), 1, **PADDINGS[mode])
        want = skimage.filters.laplace(padded)[1:-1, 1:-1]
        got = cvkern.laplace(image, mode=mode, cval=0.7)
        np.testing.assert_allclose(got, want, rtol=0, atol=error("laplace", image, 0.7))


@pytest.mark.parametrize("name", NAMES)
def test_a_mask_clears_its_surroundings(backend, name):
    for shape in SHAPES:
        image = noise(*shape)
        mask = np.random.default_rng(1).random(shape) > 0.05
        got = getattr(cvkern, name)(image, mask=mask)
        want = getattr(skimage.filters, name)(image.astype(float), mask=mask)
        np.testing.assert_allclose(got, want, rtol=0, atol=error(name, image))
        np.testing.assert_array_equal(got[want == 0], 0)


def test_masks_of_stacks_and_colours(backend):
    stack = np.stack([noise(20, 33), noise(20, 33)[::-1]])
    masks = np.random.default_rng(2).random(stack.shape) > 0.03
    for name in ("laplace", "sobel"):
        call = getattr(cvkern, name)
        want = np.stack([call(i, mask=m) for i, m in zip(stack, masks, strict=True)])
        np.testing.assert_array_equal(call(stack, mask=masks, batch_axis=0), want)
    color = np.stack([stack[0], stack[1], stack[0]], axis=-1)
    unmasked = cvkern.sobel(color)
    got = cvkern.sobel(color, masks[0])
    kept = got != 0
    assert kept.any()
    np.testing.assert_array_equal(got[kept], unmasked[kept])


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="image must be grey, or have a channel_axis, got"):
        cvkern.laplace(np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match=r"mask must have shape \(4, 5\), got \(5, 4\)"):
        cvkern.sobel(np.zeros((4, 5)), np.ones((5, 4)))
    with pytest.raises(ValueError, match=r"mask must have shape \(2, 4, 5\), got \(4, 5\)"):
        cvkern.laplace(np.zeros((2, 4, 5)), mask=np.ones((4, 5)), batch_axis=0)
    with pytest.raises(ValueError, match="mask must be None with channel_axis, got one"):
        cvkern.laplace(np.zeros((4, 5, 3)), mask=np.ones((4, 5)), channel_axis=-1)


@pytest.mark.parametrize("axis", [-1, 0, 1])
@pytest.mark.parametrize("mode", MODES)
def test_laplace_of_channels(backend, mode, axis):
    """Each channel is treated alone, in every bit."""
    planes = np.stack([noise(20, 33), noise(20, 33)[::-1], noise(20, 33)[:, ::-1]])
    want = np.stack([cvkern.laplace(plane, mode=mode, cval=0.7) for plane in planes])
    image = np.moveaxis(planes, 0, axis)
    got = cvkern.laplace(image, mode=mode, cval=0.7, channel_axis=axis)
    np.testing.assert_array_equal(got, np.moveaxis(want, 0, axis))
    stack = np.stack([image, image[..., ::-1]])
    got = cvkern.laplace(
        stack, mode=mode, channel_axis=axis if axis < 0 else axis + 1, batch_axis=0
    )
    alone = [cvkern.laplace(one, mode=mode, channel_axis=axis) for one in stack]
    np.testing.assert_array_equal(got, np.stack(alone))
