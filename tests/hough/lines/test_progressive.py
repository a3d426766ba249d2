"""The progressive probabilistic Hough transform against scikit-image, seed by seed."""

import numpy as np
import pytest
import skimage.data
from skimage.transform import probabilistic_hough_line

import cvkern

ANGLES = np.array([0, 0.3, 1.0, np.pi / 2, -0.7])
OPTIONS = [
    {},
    {"threshold": 5, "line_length": 15, "line_gap": 3},
    {"threshold": 1, "line_length": 0, "line_gap": 0, "theta": ANGLES},
]


def oracle(mask, **options):
    found = probabilistic_hough_line(mask, **options)
    return np.array([(*a[::-1], *b[::-1]) for a, b in found], np.int32).reshape(-1, 4)


def masks():
    edges = cvkern.canny(skimage.data.camera(), 1.5)
    yield edges[100:330, 150:370]
    yield edges[100:330, 150:370].T
    yield from (edges[200:201], edges[:, 200:201], np.zeros((9, 9)), np.full((9, 9), 7))
    yield np.random.default_rng(0).random((50, 61)) < 0.3


@pytest.mark.parametrize("options", OPTIONS)
def test_segments_are_scikit_images(backend, options):
    for mask in masks():
        for seed in (0, 1):
            got = cvkern.probabilistic_hough_line(mask, rng=seed, **options)
            assert got.dtype == np.int32
            np.testing.assert_array_equal(got, oracle(mask > 0, rng=seed, **options))


def test_a_generator_moves_on(backend):
    mask = next(masks())
    ours, theirs = np.random.default_rng(3), np.random.default_rng(3)
    for _ in range(2):
        got = cvkern.probabilistic_hough_line(mask, rng=ours, **OPTIONS[1])
        np.testing.assert_array_equal(got, oracle(mask, rng=theirs, **OPTIONS[1]))


def test_long_sides_do_not_overflow(backend):
    mask = np.zeros((2, 65536), bool)
    mask[1, 65000:] = True
    got = cvkern.probabilistic_hough_line(mask, 10, 100, theta=[np.pi / 2], rng=0)
    np.testing.assert_array_equal(got, oracle(mask, line_length=100, theta=ANGLES[3:4], rng=0))
    assert np.ptp(got[:, 1::2]) == 535


def test_what_does_not_fit_is_refused():
    mask = np.ones((4, 5), bool)
    with pytest.raises(ValueError, match="threshold must be"):
        cvkern.probabilistic_hough_line(mask, 0)
    with pytest.raises(ValueError, match=r"theta must be a list of one or more finite numbers"):
        cvkern.probabilistic_hough_line(mask, theta=[])
    with pytest.raises(TypeError, match="rng must be a seed or a NumPy generator, got 'x'"):
        cvkern.probabilistic_hough_line(mask, rng="x")
