"""Edges of a stack of images: equal to those of each image alone, in every bit."""

from typing import Any

import numpy as np
import pytest
from skimage import data

import cvkern

CALLS = {
    "default": {},
    "quantiles": {"low_threshold": 0.6, "high_threshold": 0.8, "use_quantiles": True},
    "gaussian": {"operator": "gaussian", "low_threshold": 9, "high_threshold": 30},
    "reflected": {"mode": "reflect", "norm": "l1", "operator": "scharr"},
    "opencv": {"sigma": 0, "low_threshold": 50, "high_threshold": 120, "suppression": "sectors"},
}
SHAPES = [(3, 40, 68), (2, 33, 9), (4, 2, 30), (2, 1, 1)]


def photographs(count, height, width, channels=()):
    """Return parts of a photograph; edges end at their borders, and nowhere go beyond."""
    picture = data.astronaut() if channels else data.camera()
    parts = [picture[20 * n : 20 * n + height, 130 + 9 * n :][:, :width] for n in range(count)]
    return np.stack([np.roll(part, 7 * n, axis=0) for n, part in enumerate(parts)])


def alone(images, masks=None, **options):
    given = [{}] * len(images) if masks is None else [{"mask": mask} for mask in masks]
    return np.stack([cvkern.canny(i, **options, **m) for i, m in zip(images, given, strict=True)])


@pytest.mark.filterwarnings("ignore:no edge was found")
@pytest.mark.parametrize("name", CALLS)
def test_grey(backend, name):
    for shape in SHAPES:
        images = photographs(*shape)
        want = alone(images, **CALLS[name])
        np.testing.assert_array_equal(cvkern.canny(images, **CALLS[name], batch_axis=0), want)
        assert want.any() or shape != SHAPES[0]


@pytest.mark.filterwarnings("ignore:no edge was found")
@pytest.mark.parametrize("name", CALLS)
def test_colour_and_masks(backend, name):
    images = photographs(3, 30, 41, (3,))
    want = alone(images, **CALLS[name])
    np.testing.assert_array_equal(cvkern.canny(images, **CALLS[name], batch_axis=0), want)
    masks = np.random.default_rng(0).random(images.shape[:3]) < 0.98
    want = alone(images[..., 0], masks, **CALLS[name])
    given = {"mask": masks, **CALLS[name]}
    np.testing.assert_array_equal(cvkern.canny(images[..., 0], **given, batch_axis=0), want)


def test_components_end_with_their_image(backend):
    """A weak edge that meets a strong one of the image before, or after, is not kept by it."""
    steps = np.zeros((3, 16, 16), np.uint8)
    steps[:, :, 8:] = np.array([40, 200, 40], np.uint8)[:, None, None]
    given = {"low_threshold": 60, "high_threshold": 500, "suppression": "sectors"}
    got = cvkern.canny(steps, 0, **given, mode="nearest", batch_axis=0)
    assert got.any(axis=(1, 2)).tolist() == [False, True, False]


def test_refusals():
    with pytest.raises(ValueError, match=r"batch_axis must be in \[0, 0\], got 1"):
        cvkern.canny(np.ones((2, 4, 5)), batch_axis=1)
    with pytest.raises(ValueError, match="mask must be 3-D, got shape"):
        cvkern.canny(np.ones((2, 4, 5)), mask=np.ones((4, 5)), batch_axis=0)
    with pytest.raises(ValueError, match="mask must have the shape of the image"):
        cvkern.canny(np.ones((2, 4, 5)), mask=np.ones((1, 4, 5)), batch_axis=0)


@pytest.mark.filterwarnings("ignore:no edge was found")
def test_cuda(gpu):
    torch = pytest.importorskip("torch")
    for shape in SHAPES:
        for images in (photographs(*shape), photographs(*shape, (3,))):
            for name, options in CALLS.items():
                got = cvkern.canny(torch.from_numpy(images).cuda(), **options, batch_axis=0)
                want = alone(images, **options)
                np.testing.assert_array_equal(got.cpu().numpy(), want, err_msg=name)


@pytest.mark.filterwarnings("ignore:no edge was found")
def test_subpixel_edges_of_a_stack_are_those_of_each_image(backend):
    """A stack gives a list, whose items have lengths of their own; one of them is empty."""
    for picture in (data.camera()[90:], data.astronaut()[:90]):
        images = np.stack([picture[:60, 200:268], picture[:60, :68] * 0, picture[20:80, 210:278]])
        choices: list[dict[str, Any]] = [
            {"low_threshold": 4, "high_threshold": 9},
            {"use_quantiles": True, "low_threshold": 0.8, "high_threshold": 0.9},
        ]
        for options in choices:
            got = cvkern.subpixel_edges(images, **options, batch_axis=0)
            want = [cvkern.subpixel_edges(image, **options) for image in images]
            assert isinstance(got, list)
            assert [len(w.strength) > 0 for w in want] == [True, False, True]
            for one, alone_ in zip(got, want, strict=True):
                for a, b in zip(one, alone_, strict=True):
                    np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match=r"batch_axis must be in \[0, 0\], got 1"):
        cvkern.subpixel_edges(images, batch_axis=1)
