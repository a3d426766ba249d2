"""Votes of a stack of masks: those of each mask alone, in every bit."""

from functools import partial

import numpy as np
import pytest

import cvkern
from tests.calls import fields

SHAPES = [(3, 30, 41), (4, 7, 70), (2, 1, 1)]
LINES = {
    "mask": {},
    "weights": {"weights": True},
    "directed": {"orientation": True},
    "tolerance": {"orientation": True, "orientation_tolerance": 0.1, "weights": True},
}
CIRCLES = {
    "rings": {},
    "outside": {"full_output": True, "normalize": False},
    "directed": {"orientation": True, "normalize": False},
    "tolerance": {"orientation": True, "orientation_tolerance": 0.3, "full_output": True},
}


def masks(shape):
    """Return masks that differ in density; one is empty, if there are several."""
    rng = np.random.default_rng(3)
    found = rng.random(shape) < np.linspace(0.4, 0.05, shape[0])[:, None, None]
    found[1:2] = False
    return found


def given(options, shape):
    rng = np.random.default_rng(4)
    values = {
        "weights": rng.random(shape, np.float32),
        "orientation": rng.uniform(-3, 3, shape).astype(np.float32),
    }
    return {k: values[k] if v is True and k in values else v for k, v in options.items()}


def alone(call, found, options):
    arrays = {k: v for k, v in options.items() if isinstance(v, np.ndarray)}
    same = {k: v for k, v in options.items() if k not in arrays}
    return np.stack(
        [call(m, **same, **{k: v[n] for k, v in arrays.items()}) for n, m in enumerate(found)]
    )


def lines(found, **options):
    theta = np.linspace(-1.5, 1.5, 37)
    return cvkern.hough_line(found, theta, rho_step=0.75, **options).votes


def circles(found, **options):
    return cvkern.hough_circle(found, [1, 3, 6], **options)


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("shape", SHAPES)
def test_lines(backend, name, shape):
    options, found = given(LINES[name], shape), masks(shape)
    want = alone(lines, found, options)
    np.testing.assert_array_equal(lines(found, **options, batch_axis=0), want)


@pytest.mark.parametrize("name", CIRCLES)
@pytest.mark.parametrize("shape", SHAPES[:2])
def test_circles(backend, name, shape):
    options, found = given(CIRCLES[name], shape), masks(shape)
    want = alone(circles, found, options)
    np.testing.assert_array_equal(circles(found, **options, batch_axis=0), want)


def test_weights_of_one_image_bound_the_votes(backend):
    """Images of a stack do not add up: each alone stays below 2^31, and so does the stack."""
    found = np.ones((3, 20, 20), bool)
    heavy = np.full(found.shape, 2.0**31 / 256 / 400 * 0.9, np.float32)
    votes = cvkern.hough_line(found, weights=heavy, batch_axis=0).votes
    np.testing.assert_array_equal(votes[2], cvkern.hough_line(found[2], weights=heavy[2]).votes)


def test_refusals():
    found, turned = np.ones((2, 5, 6)), np.zeros((2, 5, 6), np.float32)
    turned[1, 3, 4] = np.nan
    with pytest.raises(ValueError, match=r"batch_axis must be in \[0, 0\], got 1"):
        cvkern.hough_line(found, batch_axis=1)
    with pytest.raises(ValueError, match="mask must be 3-D"):
        cvkern.hough_circle(found[0], 2, batch_axis=0)
    with pytest.raises(ValueError, match="batch_axis must be None with points, got 0"):
        cvkern.hough_line(points=np.ones((3, 2)), shape=(5, 6), batch_axis=0)
    with pytest.raises(ValueError, match=r"got nan at \(1, 3, 4\)"):
        cvkern.hough_circle(found, 2, orientation=turned, batch_axis=0)
    with pytest.raises(ValueError, match="orientation must have shape"):
        cvkern.hough_line(found, orientation=turned[0], batch_axis=0)


def test_cuda(gpu):
    torch = pytest.importorskip("torch")
    for shape in SHAPES[:2]:
        found = masks(shape)
        for call, cases in ((lines, LINES), (circles, CIRCLES)):
            for name, case in cases.items():
                options = given(case, shape)
                want = alone(call, found, options)
                there = {
                    k: torch.from_numpy(v).cuda() if isinstance(v, np.ndarray) else v
                    for k, v in options.items()
                }
                got = call(torch.from_numpy(found).cuda(), **there, batch_axis=0)
                np.testing.assert_array_equal(got.cpu().numpy(), want, err_msg=name)


def scenes(channels=()):
    """Return three pictures: a disc and a turned square, neither of them, and the disc alone."""
    y, x = np.mgrid[:90, :120]
    disc = np.hypot(y - 40, x - 35) < 22
    square = np.maximum(np.abs(y - 50 + 0.3 * (x - 90)), np.abs(x - 90 - 0.3 * (y - 50))) < 20
    grey = np.stack([30 + 150 * (disc | square), np.full((90, 120), 30), 30 + 150 * disc])
    shape = (*grey.shape, *([1] * len(channels)))
    return np.broadcast_to(grey.reshape(shape), (*grey.shape, *channels)).astype(np.uint8)


DETECTORS = {
    "detect_lines": {"min_votes": 8.0},
    "detect_segments": {"min_length": 15.0},
    "detect_circles": {"radius_range": (10, 30)},
    "detect_ellipses": {"axis_range": (10, 30)},
}


@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("name", DETECTORS)
def test_detectors_return_a_list(backend, name, channels):
    call, images = partial(getattr(cvkern, name), **DETECTORS[name]), scenes(channels)
    got, want = call(images, batch_axis=0), [call(image) for image in images]
    assert isinstance(got, list)
    assert len(fields(want[0])[0]) > 0
    assert not len(fields(want[1])[0])
    for one, other in zip(got, want, strict=True):
        for a, b in zip(fields(one), fields(other), strict=True):
            np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match=r"batch_axis must be in \[0, 0\], got 1"):
        call(images, batch_axis=1)


def test_shapes_of_several_scenes(backend):
    images = scenes()
    template, options = images[0, 22:80, 60:118], {"rotations": 4, "scales": [1.0, 1.1]}
    got = cvkern.detect_shape(template, images, **options, batch_axis=0)
    want = [cvkern.detect_shape(template, image, **options) for image in images]
    assert [len(found.votes) for found in want][:2] == [1, 0]
    for one, other in zip(got, want, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
