"""Mosaics and the ways back: filters, directions, residuals, borders and quality."""

import cv2
import imageio.v3 as iio
import numpy as np
import pytest

import cvkern
from tests.raw import reference_demosaicing as reference
from tests.truth import truth

PATTERNS = ["RGGB", "BGGR", "GRBG", "GBRG"]
METHODS = ["bilinear", "malvar", "menon", "residual"]


def picture(shape, seed=0):
    """Return soft colours with edges, in 0 to 255."""
    rng = np.random.default_rng(seed)
    noise = rng.random((*shape, 3))
    soft = cv2.GaussianBlur(noise, (0, 0), 2)
    soft = (soft - soft.min()) / np.ptp(soft)
    soft[shape[0] // 3 :, shape[1] // 2 :] *= [0.3, 0.9, 0.6]
    return soft * 255


@pytest.mark.parametrize("pattern", PATTERNS)
def test_mosaic(pattern):
    image = np.random.default_rng(1).integers(0, 256, (5, 8, 3)).astype(np.uint8)
    masks = reference.kinds((5, 8), pattern)
    want = np.select(masks, [image[..., k] for k in range(3)])
    got = cvkern.mosaic(image, pattern)
    assert got.dtype == np.uint8
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("method", METHODS)
def test_demosaic_is_the_stated_method(backend, method, pattern):
    """In float32 and float64.

    The weight of a line is the inverse of the variance that it leaves, at least 6e-5 of the squared
    mean, from which float32 is off by some 2^-24: weights by 0.5 %, and lines that differ by two
    grey values then by 0.01. What the other methods round is below 2e-4.
    """
    for shape in ((41, 58), (30, 257), (30, 258)):  # kernels take 128 pixels at once
        raw = cvkern.mosaic(picture(shape), pattern)
        want = getattr(reference, method)(raw, pattern)
        # Menon's steps reach 11 pixels, and his borders were never stated.
        border = 12 if method == "menon" else 0
        inner = np.s_[border : shape[0] - border, border : shape[1] - border]
        got = cvkern.demosaic(raw.astype(np.float32), pattern, method)
        assert got.dtype == np.float32
        off = 0.01 if method == "residual" else 2e-4
        np.testing.assert_allclose(got[inner], want[inner], rtol=0, atol=off)


def test_of_two_equal_directions_menon_takes_the_row(backend):
    """Changes of two grey values are exact, and often equal in both directions."""
    raw = 8.0 * np.random.default_rng(4).integers(0, 2, (40, 60))
    got = cvkern.demosaic(raw.astype(np.float32), "RGGB", "menon")
    want = reference.menon(raw, "RGGB")
    np.testing.assert_allclose(got[12:-12, 12:-12], want[12:-12, 12:-12], rtol=0, atol=2e-4)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", [(2, 2), (3, 7), (290, 67)])
def test_integers_are_rounded_floats(backend, method, shape, dtype):
    high = np.iinfo(dtype).max
    raw = np.random.default_rng(2).integers(0, high, shape, dtype, endpoint=True)
    got = cvkern.demosaic(raw, "GRBG", method)
    real = cvkern.demosaic(raw.astype(np.float32), "GRBG", method)
    assert got.dtype == dtype
    np.testing.assert_array_equal(got, np.floor(np.clip(real + np.float32(0.5), 0, high)))


@pytest.mark.parametrize("method", METHODS)
def test_both_sets_give_the_same_bits(method):
    rng = np.random.default_rng(3)
    pictures = [rng.integers(0, 4096, (67, 90)) / 7]
    # A few bright pixels in black: rounding errors of zeros must not be divided by one another.
    for height, width in ((34, 26), (19, 21), (3, 17), (38, 39)):
        lit = rng.random((height, width)) < 0.1
        pictures.append(np.where(lit, rng.random((height, width)), 0.0))
    for raw in pictures:
        answers = []
        for name in ("warp", "taichi"):
            pytest.importorskip(name)
            with cvkern.use(backend=name):
                answers.append(cvkern.demosaic(raw.astype(np.float32), "BGGR", method))
        np.testing.assert_array_equal(*answers)


def test_bilinear_is_that_of_opencv(backend):
    raw = np.random.default_rng(4).integers(0, 256, (40, 50)).astype(np.uint8)
    want = cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2RGB)
    got = cvkern.demosaic(raw, method="bilinear")
    np.testing.assert_array_equal(got[1:-1, 1:-1], want[1:-1, 1:-1])


@pytest.mark.parametrize("method", METHODS)
def test_grey_ramps_are_kept_and_values_scale(backend, method):
    ramp = np.linspace(10, 200, 100, dtype=np.float32)[:, None] + np.zeros((1, 50), np.float32)
    inner = np.s_[36:-36]  # beyond, methods see how the ramp is mirrored
    got = cvkern.demosaic(ramp, method=method)
    np.testing.assert_allclose(got[inner], np.stack([ramp] * 3, -1)[inner], rtol=1e-4)
    raw = cvkern.mosaic(picture((30, 40))).astype(np.float32)
    once, twice = (cvkern.demosaic(raw * scale, method=method) for scale in (1, 2.0**-12))
    np.testing.assert_array_equal(once, twice * 2**12)


def test_wide_floats_come_back_and_constants_stay(backend):
    for dtype in (np.float16, np.float64):
        got = cvkern.demosaic(np.full((9, 8), 3, dtype))
        assert got.dtype == dtype
        np.testing.assert_array_equal(got, 3)
    assert not cvkern.demosaic(np.zeros((20, 20), np.uint8)).any()


@pytest.mark.parametrize(
    ("folder", "least"),
    [
        ("mcmaster", {"malvar": 34.0, "menon": 33.6, "residual": 36.4}),
        ("kodak24_500", {"malvar": 34.6, "menon": 38.3, "residual": 39.0}),
    ],
)
def test_quality_on_photographs(folder, least):
    """Mean PSNR of colours, in dB; other libraries' Malvar and Menon have the same."""
    found = {method: [] for method in least}
    for path in sorted((truth("light_colour") / "demosaic" / folder).glob("*.png")):
        image = iio.imread(path)[..., :3]
        for method in least:
            off = cvkern.demosaic(cvkern.mosaic(image), method=method)[10:-10, 10:-10].astype(float)
            error = np.mean((off - image[10:-10, 10:-10]) ** 2)
            found[method].append(10 * np.log10(255**2 / error))
    for method, low in least.items():
        assert np.mean(found[method]) > low


@pytest.mark.parametrize(
    ("error", "message", "arguments"),
    [
        (ValueError, "raw must be 2-D, got shape (4, 4, 3)", (np.zeros((4, 4, 3)),)),
        (ValueError, "raw must have sides of at least 2 pixels, got (1, 9)", (np.zeros((1, 9)),)),
        (TypeError, "raw must be uint8, uint16 or floating, got int32",
         (np.zeros((4, 4), np.int32),)),
        (
            ValueError,
            "pattern must be one of ('RGGB', 'BGGR', 'GRBG', 'GBRG'), got 'RGB'",
            (np.zeros((4, 4)), "RGB"),
        ),
        (
            ValueError,
            "method must be one of ('bilinear', 'malvar', 'menon', 'residual'), got 'vng'",
            (np.zeros((4, 4)), "RGGB", "vng"),
        ),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, error, message, arguments):
    with pytest.raises(error) as info:
        cvkern.demosaic(*arguments)
    assert str(info.value) == message


def test_mosaic_errors():
    with pytest.raises(ValueError, match=r"^image must have shape \(H, W, 3\), got \(4, 4, 2\)$"):
        cvkern.mosaic(np.zeros((4, 4, 2)))
