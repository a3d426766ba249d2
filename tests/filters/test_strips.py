"""Images with more elements than kernels can index: strips give the bits of the whole image."""

import inspect

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern import _strips
from tests.calls import fields

GREY = {
    "gaussian": [{"sigma": 3}, {"sigma": 2, "dtype": "uint8"}, {"sigma": 2, "mode": "constant"}],
    "box": [{"radius": 4}],
    "correlate_separable": [{"taps": [0.2, 0.5, 0.3]}],
    "gradient": [{"sigma": 2}],
    "median": [{"radius": 2}],
    "canny": [{"sigma": 2}, {"use_quantiles": True, "low_threshold": 0.6, "high_threshold": 0.9}],
    "sobel": [{}, {"axis": 0}],
    "scharr": [{}],
    "prewitt": [{}],
    "laplace": [{}],
}
COLOR = {
    "gaussian": {"sigma": 3, "channel_axis": -1},
    "median": {"channel_axis": 2},
    "canny": {},
    "sobel": {},
    "laplace": {"channel_axis": -1},
}


@pytest.fixture
def few(monkeypatch):
    """Let a strip have at most 2000 elements, and count the strips."""
    from cvkern import scale

    monkeypatch.setattr(_strips, "MAX_ELEMENTS", 16_000)
    calls = []
    apply = scale.apply
    monkeypatch.setattr(scale, "apply", lambda *a, **k: calls.append(k["tile"]) or apply(*a, **k))
    return calls


def whole(name, image, options):
    return inspect.unwrap(getattr(cvkern, name))(image, **options)


def assert_equal(got, want):
    assert type(got) is type(want)
    for a, b in zip(fields(got), fields(want), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", GREY)
def test_grey(backend, few, name):
    image = skimage.data.camera()[100:250, 130:260]
    for options in GREY[name]:
        assert_equal(getattr(cvkern, name)(image, **options), whole(name, image, options))
    assert few == [(15, 130)] * len(GREY[name])


@pytest.mark.parametrize("name", COLOR)
def test_colour(backend, few, name):
    image = skimage.data.astronaut()[20:120, 150:240]
    got = getattr(cvkern, name)(image, **COLOR[name])
    assert_equal(got, whole(name, image, COLOR[name]))
    assert few == [(7, 90)]


def test_out_is_filled(few):
    image = skimage.data.camera()[100:250, 130:260]
    out = np.empty(image.shape, np.float32)
    assert cvkern.gaussian(image, 2, out=out) is out
    np.testing.assert_array_equal(out, whole("gaussian", image, {"sigma": 2}))
    assert len(few) == 1


@pytest.mark.parametrize("axis", [0, 1])
def test_long_images(few, monkeypatch, axis):
    """No side of a strip is longer than that of a tile may be."""
    monkeypatch.setattr(_strips, "MAX_ELEMENTS", 2**20)
    image = np.zeros((2**20 + 1, 1) if axis == 0 else (16, 2**16 + 9), np.uint8)
    image[0] = image[-1] = 9
    np.testing.assert_array_equal(cvkern.median(image, 1), whole("median", image, {"radius": 1}))
    assert few == [(2**16, 1) if axis == 0 else (1, 2**16)]


def test_what_strips_cannot_do_is_refused(few, monkeypatch):
    image = np.zeros((150, 130), np.uint8)
    with pytest.raises(ValueError, match="mode must not be 'wrap' in tiles"):
        cvkern.gaussian(image, mode="wrap")
    monkeypatch.setattr("cvkern._checks.MAX_ELEMENTS", 16_000)
    monkeypatch.setattr(cvkern._checks.check_image, "__kwdefaults__", {
        **cvkern._checks.check_image.__kwdefaults__, "most": 16_000,
    })  # fmt: skip
    with pytest.raises(ValueError, match="image must have at most 16000 elements"):
        cvkern.gaussian(np.stack([image, image]), batch_axis=0)
