"""The colour of the light: scenes of known light, exclusions, and real ones."""

import json
from typing import Any

import cv2
import numpy as np
import pytest
import scipy.ndimage

import cvkern
from cvkern.color.constancy import METHODS
from tests.truth import truth

LIGHT = np.array([1.0, 0.7, 0.35])


def scene(shape=(70, 90), seed=0):
    """Return paints in blocks with grey ones among them, textured, under LIGHT."""
    rng = np.random.default_rng(seed)
    paints = rng.uniform(0.05, 0.9, (7, 9, 3))
    paints[::2] = paints[::2, :, :1]
    image = np.repeat(np.repeat(paints, 10, 0), 10, 1)[: shape[0], : shape[1]]
    return image * rng.uniform(0.8, 1, (*image.shape[:2], 1)) * LIGHT * 0.9


def angle(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


@pytest.mark.parametrize("method", METHODS)
def test_grey_scenes_tell_their_light(backend, method):
    grey = np.random.default_rng(1).uniform(0.02, 0.9, (60, 50, 1)) * LIGHT
    assert angle(cvkern.estimate_illuminant(grey, method), LIGHT) < 0.6
    assert angle(cvkern.estimate_illuminant(scene(), method), LIGHT) < 8


@pytest.mark.parametrize(("method", "order", "p"), [("grey_edge", 1, 1), ("grey_edge_2", 2, 2)])
def test_edges_are_means_of_derivatives(method, order, p):
    """J. van de Weijer et al. 2007: a Minkowski norm of lengths of derivatives of a Gaussian."""
    image = np.random.default_rng(5).uniform(0.05, 0.9, (40, 50, 3)) ** [1, 2, 3]
    image[0, 0] = 0.94  # below what counts as saturated, and the largest value of all channels
    found = []
    for channel in np.moveaxis(image, 2, 0) / image.max():

        def part(rows, columns, channel=channel):
            first = scipy.ndimage.gaussian_filter1d(channel, 1.0, axis=0, order=rows)
            return scipy.ndimage.gaussian_filter1d(first, 1.0, axis=1, order=columns)

        if order == 1:
            square = part(1, 0) ** 2 + part(0, 1) ** 2
        else:
            square = part(2, 0) ** 2 + part(0, 2) ** 2 + 4 * part(1, 1) ** 2
        found.append(np.mean(np.sqrt(square)[3:-3, 3:-3] ** p) ** (1 / p))
    got = cvkern.estimate_illuminant(image, method, white=0.99)
    np.testing.assert_allclose(got, np.array(found) / max(found), rtol=1e-6)


def test_bright_and_dark_is_the_axis_of_both():
    """D. Cheng, D. Prasad and M. Brown 2014: the pixels that are extreme along the mean colour."""
    pixels = np.random.default_rng(8).uniform(0.05, 0.9, (1600, 3)) ** [1, 2, 3]
    found = cvkern.estimate_illuminant(pixels.reshape(40, 40, 3), "bright_and_dark", white=2.0)
    along = pixels @ pixels.mean(axis=0)
    low, high = np.sort(along)[[55, -56]]  # 3.5 % are 56
    axis = np.abs(np.linalg.svd(pixels[(along <= low) | (along >= high)])[2][0])
    np.testing.assert_allclose(found, axis / axis.max(), rtol=1e-6)


def test_the_default_is_a_mean_of_three():
    image = scene()
    parts = [cvkern.estimate_illuminant(image, m) for m in
             ("grayness_index", "grayness_index", "grey_edge", "white_patch")]  # fmt: skip
    want = np.sum([part / part.sum() for part in parts], axis=0)
    np.testing.assert_allclose(cvkern.estimate_illuminant(image), want / want.max(), rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_scale_black_and_what_is_masked(method):
    image = scene()
    want = cvkern.estimate_illuminant(image, method)
    raw = image * 1000 + 64
    # Raw values are rounded to float32, by 2^-24 of up to 1000: single pixels are off by 1e-6.
    np.testing.assert_allclose(cvkern.estimate_illuminant(raw, method, black=64), want, rtol=1e-6)
    mask = np.ones(image.shape[:2], bool)
    mask[:, :20] = False
    first, second = image.copy(), image.copy()
    second[:, :16] *= [0.2, 0.5, 0.9]  # three pixels further derivatives see none of it
    first[0, 0] = second[0, 0] = image.max()
    answers = [cvkern.estimate_illuminant(i, method, mask=mask, white=1.0) for i in (first, second)]
    # The same pixels count; filters that run along rows carry their rounding beyond the mask.
    np.testing.assert_allclose(*answers, rtol=1e-14)


def test_saturated_pixels_do_not_count():
    image = np.tile(LIGHT * 0.5, (40, 40, 1)) * np.random.default_rng(2).random((40, 40, 1))
    image[:9] = 1.0
    for method in ("grey_world", "white_patch", "bright_and_dark"):
        assert angle(cvkern.estimate_illuminant(image, method), LIGHT) < 1e-3


def test_values_at_the_limit(backend):
    """245 / 250 is the limit in float64, which is above it in float32."""
    image = np.full((5, 5, 3), 50, np.uint8)
    image[0, 0], image[4, 4] = (245, 10, 20), 250
    np.testing.assert_array_equal(cvkern.estimate_illuminant(image, "grey_world"), np.ones(3))


@pytest.mark.parametrize("method", METHODS)
def test_one_colour_is_that_of_the_light(method):
    for shape in ((40, 50, 1), (1, 1, 1)):
        got = cvkern.estimate_illuminant(np.tile(LIGHT, shape), method)
        # Taps of second derivatives add up to 1e-5, not 0.
        np.testing.assert_allclose(got, LIGHT / LIGHT.max(), rtol=1e-3)


def test_nothing_to_see():
    for image in (np.zeros((8, 9, 3)), np.ones((8, 9, 3)), np.full((8, 9, 3), np.nan)):
        np.testing.assert_array_equal(cvkern.estimate_illuminant(image), 1)


def test_large_images_are_averaged():
    image = np.kron(scene(), np.ones((9, 9, 1)))
    got, want = (cvkern.estimate_illuminant(i, "grey_world") for i in (image, scene()))
    np.testing.assert_allclose(got, want, rtol=5e-3)


def test_white_balance(backend):
    got = cvkern.white_balance(np.array([[LIGHT, LIGHT / 2]]), LIGHT)
    np.testing.assert_allclose(got, [[[0.7] * 3, [0.35] * 3]], rtol=1e-6)


def test_photographs_of_known_light():
    """Mean, median and worst quarter in degrees; below any other method's mean on every third."""
    folder = truth("light_colour") / "white_balance" / "intel_imx135"
    lights = json.loads((folder / "illuminants_rgb.json").read_text())
    errors = {method: [] for method in ("consensus", "grey_world", "white_patch", "grey_edge")}
    for name, light in sorted(lights.items()):
        stored: Any = cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED)
        image = stored[..., ::-1]
        for method, found in errors.items():
            found.append(angle(cvkern.estimate_illuminant(image, method), light))
    ours = np.array(errors["consensus"])
    assert ours.mean() < 2.1
    assert np.median(ours) < 1.3
    assert np.sort(ours)[-4:].mean() < 4.0
    for third in range(3):
        rivals = [np.mean(e[third::3]) for m, e in errors.items() if m != "consensus"]
        assert ours[third::3].mean() < max(rivals)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("image must have shape (H, W, 3), got (4, 4, 4)",
         lambda: cvkern.estimate_illuminant(np.ones((4, 4, 4)))),
        ("mask must have shape (4, 4), got (3, 3)",
         lambda: cvkern.estimate_illuminant(np.ones((4, 4, 3)), mask=np.eye(3))),
        ("white must be above black, 5, got 4",
         lambda: cvkern.estimate_illuminant(np.ones((4, 4, 3)), black=5, white=4)),
        ("illuminant must be three positive numbers, got [1.0, 0.0, 1.0]",
         lambda: cvkern.white_balance(np.ones((4, 4, 3)), [1, 0, 1])),
    ],
)  # fmt: skip
def test_errors(message, call):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        call()
    assert str(info.value) == message
