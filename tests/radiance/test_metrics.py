"""PSNR and SSIM against scikit-image."""

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from cvkern.radiance import psnr, ssim

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("shape", [(11, 11), (20, 31), (24, 17, 3), (12, 40, 1)])
@pytest.mark.parametrize("data_range", [1.0, 255.0])
def test_like_scikit_image(shape, data_range):
    truth = data_range * RNG.random(shape)
    image = truth + 0.2 * data_range * RNG.normal(size=shape)
    want = peak_signal_noise_ratio(truth, image, data_range=data_range)
    assert psnr(image, truth, data_range=data_range) == pytest.approx(want, rel=1e-12)
    want = structural_similarity(
        truth, image, data_range=data_range, gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False, channel_axis=2 if len(shape) == 3 else None,
    )  # fmt: skip
    assert ssim(image, truth, data_range=data_range) == pytest.approx(want, rel=1e-10)


def test_equal_pictures():
    image = RNG.random((15, 15))
    assert psnr(image, image) == np.inf
    assert ssim(image, image) == pytest.approx(1)
    flat = np.zeros((15, 15))
    assert ssim(flat, flat) == 1


def test_bytes_are_not_rescaled():
    image = np.array([[10, 20], [30, 40]], np.uint8)
    assert psnr(image, image + np.uint8(1), data_range=255) == pytest.approx(20 * np.log10(255))


@pytest.mark.parametrize("metric", [psnr, ssim])
@pytest.mark.parametrize(("dtype", "most"), [("uint8", 255), ("uint16", 65535), ("float32", 1)])
def test_the_range_is_that_of_the_dtype(metric, dtype, most):
    a, b = ((RNG.random((12, 13)) * most).astype(dtype) for _ in range(2))
    assert metric(a, b) == metric(a, b, data_range=most)


@pytest.mark.parametrize("metric", [psnr, ssim])
def test_other_ranges_are_not_guessed(metric):
    image = np.zeros((12, 12), np.uint8)
    with pytest.raises(ValueError, match="data_range must be given for uint8 and float64, got"):
        metric(image, image / 255)
    with pytest.raises(ValueError, match="data_range must be given for int64 and int64, got None"):
        metric(image.tolist(), image.tolist())


@pytest.mark.parametrize("metric", [psnr, ssim])
def test_errors(metric):
    image = np.zeros((12, 12))
    with pytest.raises(ValueError, match=r"image must have the shape of truth, \(12, 13\), got"):
        metric(image, np.zeros((12, 13)))
    with pytest.raises(ValueError, match="data_range must be > 0, got 0"):
        metric(image, image, data_range=0)
    with pytest.raises(ValueError, match="image must be 2-D or 3-D"):
        metric(np.zeros(12), image)
    with pytest.raises(TypeError, match="truth must hold real numbers"):
        metric(image, image + 1j)


def test_pictures_too_small_for_ssim():
    with pytest.raises(ValueError, match="image must have at least 11 x 11 pixels"):
        ssim(np.zeros((10, 12)), np.zeros((10, 12)))
