"""Corners against scikit-image."""

import numpy as np
import pytest
import skimage.data
import skimage.feature

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.calls import MODES, noise

PHOTO = skimage.data.camera()[::4, ::4]
CHECKS = np.kron(np.indices((5, 6)).sum(axis=0) % 2, np.ones((13, 13)))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("options", [{}, {"method": "eps", "sigma": 2.0}, {"k": 0.2}])
def test_harris_is_skimages(backend, options, mode):
    image = noise(31, 40)
    got = cvkern.corner_harris(image, mode=mode, **options)
    tensor = skimage.feature.structure_tensor(
        image.astype(float), options.get("sigma", 1), mode=mode, order="rc"
    )
    det, trace = tensor[0] * tensor[2] - tensor[1] ** 2, tensor[0] + tensor[2]
    if options.get("method", "k") == "k":
        want = det - options.get("k", 0.05) * trace**2
    else:
        want = 2 * det / (trace + 1e-6)
    np.testing.assert_allclose(got, want, rtol=0, atol=np.abs(want).max() * 2e-6)
    if mode == "constant":
        theirs = skimage.feature.corner_harris(image.astype(float), **options)
        np.testing.assert_allclose(got, theirs, rtol=0, atol=np.abs(theirs).max() * 2e-6)


@pytest.mark.parametrize("sigma", [0.7, 1, 3])
def test_shi_tomasi_is_skimages(backend, sigma):
    image = PHOTO.astype(float)
    got = cvkern.corner_shi_tomasi(image, sigma)
    want = skimage.feature.corner_shi_tomasi(image, sigma)
    np.testing.assert_allclose(got, want, rtol=0, atol=np.abs(want).max() * 2e-6)


@pytest.mark.parametrize(
    "options",
    [{}, {"min_distance": 3, "threshold_rel": 0.05}, {"min_distance": 5, "exclude_border": False},
     {"threshold_abs": 0.3, "exclude_border": 7, "num_peaks": 9}],
)  # fmt: skip
def test_peaks_are_skimages(backend, options):
    """Without ties: every value is another."""
    image = noise(60, 70, seed=4)
    got = cvkern.corner_peaks(image, **options)
    theirs = {"num_peaks": np.inf, **options}
    want = skimage.feature.corner_peaks(image, **theirs)
    np.testing.assert_array_equal(got, want)


def test_peaks_that_tie(backend):
    image = np.zeros((9, 12))
    image[2, 3:6] = image[6, 2] = image[6, 9] = 1
    assert cvkern.corner_peaks(image, 2).tolist() == [[2, 3], [6, 2], [6, 9]]
    assert cvkern.corner_peaks(image, 2, num_peaks=1).tolist() == [[2, 3]]
    assert cvkern.corner_peaks(np.ones((5, 5))).shape == (0, 2)


@pytest.mark.parametrize("size", [3, 7, 11])
def test_subpix_is_skimages(backend, size):
    for image in (CHECKS, skimage.data.coins()[::2, ::2].astype(float), PHOTO.astype(float)):
        points = cvkern.corner_peaks(cvkern.corner_harris(image), 4, threshold_rel=0.01)
        got = cvkern.corner_subpix(image, points, size)
        want = skimage.feature.corner_subpix(image, points, size)
        np.testing.assert_array_equal(np.isnan(got), np.isnan(want))
        # Both sums are float64; singular windows differ, where a corner runs away.
        near = np.abs(want - points).max(axis=1) < size
        np.testing.assert_allclose(got[near], want[near], rtol=0, atol=1e-4)
        assert near.sum() > 3 or size == 3


def test_subpix_of_a_single_pixel(backend):
    """All gradients meet in it, exactly: a dot without any error is one, too."""
    image = np.zeros((15, 15), np.float32)
    image[7, 8] = 4
    got = cvkern.corner_subpix(image, [[7, 8]], window_size=5)
    np.testing.assert_array_equal(got, skimage.feature.corner_subpix(image, np.array([[7, 8]]), 5))
    np.testing.assert_array_equal(got, [[7, 8]])


def test_sets_give_the_same_bits():
    found = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            measure = cvkern.corner_harris(PHOTO)
            small = cvkern.corner_shi_tomasi(PHOTO, 1.5)
            points = cvkern.corner_peaks(measure, 3)
            places = cvkern.corner_subpix(PHOTO, points)
            found.append((measure.view("u4"), small.view("u4"), points, places))
    for a, b in zip(*found, strict=True):
        np.testing.assert_array_equal(a, b)
