"""Otsu's threshold against scikit-image and OpenCV."""

import cv2
import numpy as np
import pytest
import skimage.data
import skimage.filters

import cvkern


def pictures():
    coins = skimage.data.coins()
    yield from (coins, coins[::2, ::-1], coins.astype(np.uint16) * 257, coins.astype(">u2"))
    yield from (coins.astype(np.int16) - 90, coins / 255.0, skimage.data.page())
    yield np.random.default_rng(0).integers(-128, 127, (9, 9), np.int8)
    yield np.full((3, 4), 7, np.uint8)


def test_threshold_is_scikit_images(backend):
    for image in pictures():
        got = cvkern.threshold_otsu(image)
        assert got == skimage.filters.threshold_otsu(image)
        assert got.dtype == image.dtype.newbyteorder("=")
    few = cvkern.threshold_otsu(skimage.data.coins() / 255.0, 10)
    assert few == skimage.filters.threshold_otsu(skimage.data.coins() / 255.0, 10)


def test_threshold_is_opencvs():
    for image in (skimage.data.coins(), skimage.data.camera(), skimage.data.page()):
        want, _ = cv2.threshold(image, 0, 255, cv2.THRESH_OTSU)
        assert cvkern.threshold_otsu(image) == want


def test_large_values_keep_their_differences():
    image = np.array([[1, 2, 2], [60, 61, 60]], np.int64) + 2**53
    assert cvkern.threshold_otsu(image) == 2**53 + 2


def test_what_has_no_histogram_is_refused():
    with pytest.raises(ValueError, match="image must be finite"):
        cvkern.threshold_otsu([[0.0, np.nan]])
    with pytest.raises(ValueError, match="at most 65535 apart, got 65536"):
        cvkern.threshold_otsu(np.array([[0, 65536]]))


@pytest.mark.parametrize("value", [np.float64(1.2e38), np.uint8(7), np.int32(-5)])
def test_one_value_is_its_own_threshold(backend, value):
    found = cvkern.threshold_otsu(np.full((3, 2), value))
    assert found == value
    assert found.dtype == value.dtype
