"""Sub-pixel edges against pictures whose edges are known."""

import numpy as np
import pytest

import cvkern
from tests.calls import blobs
from tests.radiance.reference_rendering import disc, half_plane

ANGLES = np.deg2rad([0, 7, 30, 45, 71, 90, 118, 135, 180, -1, -45, -90, -163])
PIXEL = 1 / 12  # variance of the box that a pixel averages over


@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("angle", ANGLES)
def test_straight_steps_are_found_within_a_twentieth_of_a_pixel(backend, angle, sigma):
    """Every single point; the worst error is 0.042 at sigma 1 and 0.012 at sigma 2."""
    for shift in (0, 0.13, 0.5, 0.77):
        distance = 20 * np.sin(angle) + 24 * np.cos(angle) + shift
        image = half_plane((41, 49), angle, distance)
        edges = cvkern.subpixel_edges(image, sigma, 0.16, 0.4)
        y, x = edges.points.T
        inside = (y > 8) & (y < 32) & (x > 8) & (x < 40)  # the border bends the step
        error = np.sin(angle) * y + np.cos(angle) * x - distance
        assert np.abs(error[inside]).max() < (0.05 if sigma < 2 else 0.02)
        # A point for each row, or column, that the step runs through.
        assert inside.sum() >= 22
        turn = np.angle(np.exp(1j * (edges.orientation - angle)))
        assert np.abs(turn[inside]).max() < 0.03
        # The slope of a blurred unit step at a pixel up to half a diagonal from its top.
        top = 1 / np.sqrt(2 * np.pi * (sigma**2 + PIXEL))
        lowest = top * np.exp(-0.5 * 0.5 / (sigma**2 + PIXEL))
        assert np.all(edges.strength[inside] < 8 * 1.01 * top)
        assert np.all(edges.strength[inside] > 8 * 0.99 * lowest)


@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("radius", [6.0, 8.0, 12.5, 20.3])
def test_discs_are_found_within_a_twentieth_of_a_pixel(backend, radius, sigma):
    """Every single point, but for the known shift of blurred curves toward their centre."""
    for centre in ((30, 30), (30.5, 29.75), (29.6, 30.31)):
        image = disc((60, 60), centre, radius)
        edges = cvkern.subpixel_edges(image, sigma, 0.16, 0.4)
        y, x = (edges.points - np.asarray(centre, np.float32)).T.astype(float)
        bias = (sigma**2 + PIXEL) / (2 * radius)
        assert np.abs(np.hypot(y, x) - (radius - bias)).max() < 0.05
        # All the way round; where points on rows give way to points on columns, one is missing.
        angles = np.sort(np.arctan2(y, x))
        gaps = np.diff(angles, append=angles[0] + 2 * np.pi) * radius
        assert gaps.max() < 2.2
        turn = np.angle(np.exp(1j * (edges.orientation - np.arctan2(-y, -x))))
        assert np.abs(turn).max() < 0.1


def test_points_are_edges_of_canny_in_raster_order(backend):
    image = blobs(50, 70)
    mask = cvkern.canny(image, 1.5, 24, 64, operator="gaussian", mode="reflect")
    gradient = cvkern.gradient(image, sigma=1.5)
    edges = cvkern.subpixel_edges(image, 1.5, 24, 64)
    assert edges.points.dtype == edges.orientation.dtype == edges.strength.dtype == np.float32
    assert 0.5 * mask.sum() < len(edges.points) <= mask.sum()

    # A point has moved along one axis, by less than a pixel: its pixel has this strength.
    index = {}
    for y, x in np.argwhere(mask):
        key = 8 * gradient.magnitude[y, x].item(), gradient.orientation[y, x].item()
        index[key] = (y, x)
    pixels = [
        index[key] for key in zip(edges.strength.tolist(), edges.orientation.tolist(), strict=True)
    ]
    assert pixels == sorted(pixels)
    moved = np.abs(edges.points - np.array(pixels))
    assert (moved.min(1) == 0).all()
    assert moved.max() < 1


def test_no_edges_are_empty_arrays(backend):
    edges = cvkern.subpixel_edges(np.zeros((5, 6)))
    assert [a.shape for a in edges] == [(0, 2), (0,), (0,)]
    assert all(a.dtype == np.float32 for a in edges)


def test_quantiles_and_options_are_those_of_canny(backend):
    image = blobs(40, 50)
    length = cvkern.gradient(image, sigma=1.2, mode="wrap").magnitude
    low, high = 8 * np.quantile(length, [0.8, 0.9])
    by_quantiles = cvkern.subpixel_edges(image, 1.2, 0.8, 0.9, use_quantiles=True, mode="wrap")
    by_lengths = cvkern.subpixel_edges(image, 1.2, low, high, mode="wrap")
    assert len(by_lengths.points)
    for a, b in zip(by_quantiles, by_lengths, strict=True):
        np.testing.assert_array_equal(a, b)
