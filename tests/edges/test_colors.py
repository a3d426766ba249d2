"""Edges of colour images: cv2.Canny's in every pixel, and what only colour shows."""

import cv2
import numpy as np
import pytest
import skimage.data
from hypothesis import given, settings
from hypothesis import strategies as st

import cvkern
from tests.calls import noise

PHOTO = np.ascontiguousarray(skimage.data.astronaut()[40:190, 130:331])


@pytest.mark.parametrize("norm", ["l1", "l2"])
@pytest.mark.parametrize("limits", [(100, 200), (40.5, 90.7), (0, 30)])
@pytest.mark.parametrize("order", [1, -1])
def test_canny_of_a_photograph_is_that_of_opencv(backend, norm, limits, order):
    photo = np.ascontiguousarray(PHOTO[..., ::order])
    want = cv2.Canny(photo, *limits, L2gradient=norm == "l2")
    got = cvkern.canny(photo, 0, *limits, suppression="sectors", norm=norm, mode="nearest")
    np.testing.assert_array_equal(got, want > 0)
    assert 0 < got.sum() < got.size / 2


@settings(max_examples=15)
@given(
    st.tuples(st.integers(1, 9), st.integers(1, 80)),
    st.sampled_from(["l1", "l2"]),
    st.integers(0, 2**20),
)
def test_canny_of_small_images_with_ties_is_that_of_opencv(backend, shape, norm, seed):
    levels = np.random.default_rng(seed).integers(0, 4, (*shape, 3))
    image = (levels * 60).astype(np.uint8)
    want = cv2.Canny(image, 100, 250, L2gradient=norm == "l2")
    got = cvkern.canny(image, 0, 100, 250, suppression="sectors", norm=norm, mode="nearest")
    np.testing.assert_array_equal(got, want > 0)


@pytest.mark.parametrize("options", [{}, {"mask": True}, {"operator": "gaussian"}])
def test_an_edge_of_one_channel_is_found(backend, options):
    """With the other channels flat, the edges are those of the channel alone."""
    image = np.full((60, 70, 3), 77.0)
    image[..., 1] = 90 + 40 * noise(60, 70)
    options = {**options, "use_quantiles": True, "low_threshold": 0.6, "high_threshold": 0.9}
    if "mask" in options:
        options["mask"] = np.arange(70) > np.arange(60)[:, None] - 20
    alone = cvkern.canny(image[..., 1], 1.5, **options)
    np.testing.assert_array_equal(cvkern.canny(image, 1.5, **options), alone)
    assert alone.any()


def colored():
    """A disc and its ground, as bright as each other, in other colours."""
    y, x = np.mgrid[:120, :140]
    inside = (24.5 - np.hypot(y - 60.2, x - 70.7)).clip(0, 1)[..., None]
    return (1 - inside) * np.array([180.0, 60, 60]) + inside * np.array([60.0, 95.65, 60])


def test_what_only_colour_shows_is_found(backend):
    image = colored()
    assert np.ptp(cvkern.images.luma(image)) < 1
    found = cvkern.detect_circles(image, (15, 40))
    np.testing.assert_allclose(found.centers, [[60.2, 70.7]], atol=0.1)
    np.testing.assert_allclose(found.radii, [24], atol=0.1)
    reduced = cvkern.detect_circles(np.kron(image, np.ones((3, 3, 1))), (45, 120))
    np.testing.assert_allclose(reduced.radii, [72], atol=0.3)
    (ellipse,) = cvkern.detect_ellipses(image, (15, 40)).axes
    np.testing.assert_allclose(ellipse, [24, 24], atol=0.2)
    edges = cvkern.subpixel_edges(image, 1.5, 100, 200)
    away = np.hypot(*(edges.points - (60.2, 70.7)).T)
    np.testing.assert_allclose(away, 24, atol=0.1)
    (shape,) = cvkern.detect_shape(image[30:91, 40:101], image, rotations=1, scales=[1]).position
    np.testing.assert_allclose(shape, [60, 70], atol=0.5)


@pytest.mark.parametrize("function", [cvkern.detect_lines, cvkern.detect_segments])
def test_lines_of_colour_are_those_of_the_channel_that_shows_them(backend, function):
    gray = skimage.data.camera()[100:250, 150:350]
    image = np.zeros((*gray.shape, 4), np.uint8)
    image[..., 2] = gray
    image[..., 3] = noise(*gray.shape) * 50
    for got, want in zip(function(image), function(gray), strict=True):
        np.testing.assert_array_equal(got, want)


def test_a_mask_with_orientation_has_no_colour():
    with pytest.raises(ValueError, match=r"image must be a mask \(H, W\) with orientation"):
        cvkern.generalized_hough(
            np.ones((5, 6, 3)), cvkern.r_table(colored()), orientation=np.zeros((5, 6))
        )
