"""Illusions: equal light in both places, and what lateral inhibition says of them."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import cvkern
from cvkern.color.illusions import DRAWN


@pytest.mark.parametrize("kind", DRAWN)
@pytest.mark.parametrize("side", [64, 101])
def test_equal_light(kind, side):
    figure = cvkern.illusion(kind, side)
    assert figure.image.shape == (side, side)
    assert figure.image.dtype == np.float32
    assert figure.image.min() >= 0
    assert figure.image.max() <= 1
    assert figure.lighter.any()
    assert figure.darker.any()
    light = [figure.image[mask] for mask in (figure.lighter, figure.darker)]
    assert [np.ptp(values) for values in light] == [0, 0]
    if kind == "mach_bands":
        assert [light[0][0], light[1][0]] == [figure.image[0, -1], figure.image[0, 0]]
    else:
        assert light[0][0] == light[1][0]


def test_inhibition_is_a_difference_of_gaussians(backend):
    image = cvkern.illusion("checker_shadow", 64).image.astype(np.float64)
    want = gaussian_filter(image, 2) - 0.8 * gaussian_filter(image, 7)
    got = cvkern.lateral_inhibition(image, 2, 7, 0.8)
    np.testing.assert_allclose(got, want, atol=2e-6)


@pytest.mark.parametrize(
    ("kind", "right"),
    [("simultaneous_contrast", True), ("checker_shadow", True), ("white", False)],
)
def test_what_inhibition_predicts(kind, right):
    """White's bars are the known failure of the model."""
    figure = cvkern.illusion(kind, 128)
    seen = cvkern.lateral_inhibition(figure.image, 1.0, 16.0)
    difference = seen[figure.lighter].mean() - seen[figure.darker].mean()
    assert (difference > 0.02) == right
    assert abs(difference) > 0.02


def test_bands_are_beside_the_ramp():
    figure = cvkern.illusion("mach_bands", 128)
    seen = cvkern.lateral_inhibition(figure.image)[64]
    assert abs(int(seen.argmax()) - 0.65 * 128) < 3
    assert abs(int(seen.argmin()) - 0.35 * 128) < 3
    assert seen.max() > seen[-1] + 0.005
    assert seen.min() < seen[0] - 0.005


def test_an_edge_tells_its_sign_and_the_fields_nothing():
    figure = cvkern.illusion("cornsweet", 128)
    seen = cvkern.lateral_inhibition(figure.image, 1.0, 4.0)[64]
    assert seen[61] > seen[66] + 0.02
    np.testing.assert_allclose(seen[:24], seen[-24:], atol=1e-4)


def test_infinite_light_has_no_answer():
    seen = cvkern.lateral_inhibition(np.full((3, 4), np.inf))
    assert np.isnan(seen).all()


def test_errors():
    with pytest.raises(ValueError, match="kind must be"):
        cvkern.illusion("hermann")
    with pytest.raises(ValueError, match="side must be"):
        cvkern.illusion("white", 10)
    with pytest.raises(ValueError, match="weight must be"):
        cvkern.lateral_inhibition(np.ones((4, 4)), weight=-1)
