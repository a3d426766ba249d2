"""Votes for circles, and their peaks, against scikit-image and NumPy."""

import numpy as np
import pytest
import skimage.data
import skimage.draw
import skimage.feature
import skimage.transform
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.calls import DTYPES, noise
from tests.hough.circles import reference_circles as reference

SHAPES = [(40, 9), (9, 40), (37, 29), (70, 600), (21, 513)]


def specks(shape, share=0.3, seed=0):
    return np.random.default_rng(seed).random(shape) < share


def ring(radius):
    return np.stack(skimage.draw.circle_perimeter(0, 0, radius), axis=1)


# --- votes all round -----------------------------------------------------------------------------


@pytest.mark.parametrize("full_output", [False, True])
@pytest.mark.parametrize("radii", [[1], [3], [2, 7, 8], [8, 2, 2]])
@pytest.mark.parametrize("shape", SHAPES)
def test_votes_are_those_of_scikit_image(backend, shape, radii, full_output):
    mask = specks(shape)
    want = skimage.transform.hough_circle(mask, radii, normalize=False, full_output=full_output)
    got = cvkern.hough_circle(mask, radii, normalize=False, full_output=full_output)
    assert got.dtype == np.int32
    np.testing.assert_array_equal(got, want)
    shares = cvkern.hough_circle(mask, radii, full_output=full_output)
    assert shares.dtype == np.float32
    sizes = np.array([len(ring(r)) for r in radii], np.float32)[:, None, None]
    np.testing.assert_array_equal(shares, got.astype(np.float32) / sizes)


def test_every_circle_is_bresenhams(backend):
    """The votes of one pixel draw the circle round it."""
    for radius in [*range(1, 60), 97, 500]:
        side = 2 * radius + 1
        votes = cvkern.hough_circle([[1]], radius, normalize=False, full_output=True)
        want = np.zeros((side, side), int)
        np.add.at(want, tuple((ring(radius) + radius).T), 1)
        np.testing.assert_array_equal(votes[0], want)


@given(
    shape=st.tuples(st.integers(1, 40), st.integers(8, 80)),
    radii=st.lists(st.integers(1, 7), min_size=1, max_size=4),
    share=st.floats(0, 1),
    seed=st.integers(0, 2**16),
)
def test_any_votes_are_those_of_scikit_image(backend, shape, radii, share, seed):
    mask = specks(shape, share, seed)
    want = skimage.transform.hough_circle(mask, radii, normalize=False)
    np.testing.assert_array_equal(cvkern.hough_circle(mask, radii, normalize=False), want)


@pytest.mark.parametrize("dtype", DTYPES)
def test_what_is_not_zero_is_set(backend, dtype):
    mask = noise(30, 20, dtype=dtype) * specks((30, 20)).astype(dtype)
    want = cvkern.hough_circle(mask != 0, [4, 5])
    np.testing.assert_array_equal(cvkern.hough_circle(mask, [4, 5]), want)
    assert want.any()


def test_votes_sum_to_pixels_times_offsets(backend):
    mask = specks((50, 60), 0.1)
    votes = cvkern.hough_circle(mask, [3, 12], normalize=False, full_output=True)
    assert votes.sum(axis=(1, 2)).tolist() == [mask.sum() * len(ring(r)) for r in (3, 12)]


def test_votes_turn_with_the_mask(backend):
    mask = specks((33, 47), 0.1)
    votes = cvkern.hough_circle(mask, [3, 12])
    turned = cvkern.hough_circle(np.rot90(mask), [3, 12])
    np.testing.assert_array_equal(turned, np.rot90(votes, axes=(1, 2)))


def test_an_empty_mask_has_no_votes(backend):
    angles = np.full((20, 30), np.nan, np.float32)  # looked at where the mask is set alone
    for orientation in (None, angles):
        votes = cvkern.hough_circle(np.zeros((20, 30)), [3, 4], orientation=orientation)
        assert votes.shape == (2, 20, 30)
        assert not votes.any()


@pytest.mark.parametrize("threads", ["1", "2", "7"])
def test_threads_do_not_show(threads, monkeypatch):
    monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
    mask, angles = specks((500, 400), 0.05), 6 * noise(500, 400) - 3
    want = skimage.transform.hough_circle(mask, [9], normalize=False)
    np.testing.assert_array_equal(cvkern.hough_circle(mask, [9], normalize=False), want)
    got = cvkern.hough_circle(mask, [9, 4], normalize=False, orientation=angles)
    np.testing.assert_array_equal(got, reference.directed(mask, angles, [9, 4], 0))


# --- votes along the gradient --------------------------------------------------------------------


@pytest.mark.parametrize("full_output", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_directed_votes(backend, shape, full_output):
    mask, angles, radii = specks(shape, 0.2), 12 * noise(*shape) - 6, [2, 9, 8]
    options = {"full_output": full_output, "orientation": angles}
    got = cvkern.hough_circle(mask, radii, normalize=False, **options)
    want = reference.directed(mask, angles, radii, 9 if full_output else 0)
    np.testing.assert_array_equal(got, want)
    if full_output:
        assert got.sum() == 2 * mask.sum() * len(radii)
    sizes = np.array([len(ring(r)) for r in radii], np.float32)[:, None, None]
    np.testing.assert_array_equal(
        cvkern.hough_circle(mask, radii, **options), want.astype(np.float32) / sizes
    )


def test_directed_votes_are_a_radius_away(backend):
    """Half a pixel by rounding, and 2^-15 of a turn by the directions, for the radius."""
    for angle in np.linspace(-np.pi, np.pi, 101):
        votes = cvkern.hough_circle(
            [[1]], 300, normalize=False, full_output=True, orientation=[[angle]]
        )
        places = np.argwhere(votes[0]) - 300
        assert len(places) == 2
        want = 300 * np.array([np.sin(angle), np.cos(angle)])
        for place in places:
            gap = min(np.abs(place - want).max(), np.abs(place + want).max())
            assert gap <= 0.5 + 300 * 2 * np.pi * 2**-15 + 300 * 2**-17


@pytest.mark.parametrize("tolerance", [0.01, 0.1, 0.5, 1.57])
def test_votes_within_a_tolerance(backend, tolerance):
    mask, angles, radii = specks((40, 50), 0.2), 6 * noise(40, 50) - 3, [1, 5, 20]
    got = cvkern.hough_circle(
        mask, radii, normalize=False, orientation=angles, orientation_tolerance=tolerance
    )
    # Angle, direction of the offset and tolerance are each rounded to 2^-14 of a turn.
    slack = 1.5 * 2 * np.pi * 2**-14 + 1e-6
    rings = [ring(r) for r in radii]
    least = reference.arcs(mask, angles, rings, tolerance - slack)
    most = reference.arcs(mask, angles, rings, tolerance + slack)
    assert (least <= got).all()
    assert (got <= most).all()
    assert most.sum() - least.sum() <= 0.2 * most.sum()  # the bounds are close to each other


def test_the_gradient_makes_a_peak_stand_out(backend):
    image = reference.disc((90, 100), 40.2, 55.7, 20) + 0.2 * noise(90, 100)
    gradient = cvkern.gradient(image, sigma=1.5)
    mask = cvkern.canny(image, 1.5, 0.32, 0.64)
    plain, directed = (
        cvkern.hough_circle(mask, 20, normalize=False, **options)[0]
        for options in ({}, {"orientation": gradient.orientation, "orientation_tolerance": 0.3})
    )
    for votes in (plain, directed):
        peak = np.unravel_index(votes.argmax(), votes.shape)
        assert np.hypot(peak[0] - 40.2, peak[1] - 55.7) < 2
    assert directed.max() / directed.mean() > 3 * plain.max() / plain.mean()


# --- peaks ---------------------------------------------------------------------------------------


def rings_drawn(circles, shape=(120, 150)):
    mask = np.zeros(shape, bool)
    for row, column, radius in circles:
        mask[skimage.draw.circle_perimeter(row, column, radius, shape=shape)] = True
    return mask


CIRCLES = [(40, 50, 20), (70, 100, 25), (85, 40, 15), (30, 110, 18)]


@pytest.mark.parametrize("options", [
    {"total_num_peaks": 4},
    {"total_num_peaks": 2},
    {"num_peaks": 1},
    {"num_peaks": 1, "threshold": 0.6},
    {"min_xdistance": 12, "min_ydistance": 9, "threshold": 0.7},
    {"min_xdistance": 20, "min_ydistance": 20, "total_num_peaks": 3},
    {"threshold": 0.9},
    {"threshold": 2.0},
    {"total_num_peaks": 4, "normalize": True, "threshold": 0.9},
])  # fmt: skip
def test_clear_peaks_are_those_of_scikit_image(backend, options):
    radii = [15, 18, 20, 25]
    mask = rings_drawn(CIRCLES)
    mask[30:36] = mask[92:95] = False  # removes a tie
    votes = skimage.transform.hough_circle(mask, radii)
    got = cvkern.hough_circle_peaks(votes, radii, **options)
    want = skimage.transform.hough_circle_peaks(votes, radii, **options)
    assert [a.dtype for a in got] == [np.float32, np.int32, np.int32, np.int32]
    found = sorted(zip(*(a.tolist() for a in got[1:]), strict=True))
    assert found == sorted(zip(*(a.tolist() for a in want[1:]), strict=True))
    # Equal votes may come in another order; shares are rounded to float32.
    np.testing.assert_allclose(got.votes, want[0], rtol=1e-6)


def test_peaks_find_the_circles(backend):
    mask = rings_drawn(CIRCLES) & specks((120, 150), 0.6) | specks((120, 150), 0.02, 1)
    radii = np.arange(12, 30)
    votes = cvkern.hough_circle(mask, radii)
    peaks = cvkern.hough_circle_peaks(votes, radii, 10, 10, total_num_peaks=4)
    found = sorted(zip(*(a.tolist() for a in (peaks.row, peaks.column, peaks.radius)), strict=True))
    assert found == sorted(CIRCLES)
    assert (np.diff(peaks.votes) <= 0).all()


def test_of_equal_peaks_the_first_comes_first(backend):
    votes = np.zeros((2, 9, 9), np.float32)
    votes[:, 4, 2:7] = 3  # one plateau: its first pixel, and what is not within one of it
    votes[1, 7, 7] = 3
    peaks = cvkern.hough_circle_peaks(votes, [5, 6], 4, 1, num_peaks=2)
    assert peaks.radius.tolist() == [5, 6]  # the same centre is not found for another radius
    peaks = cvkern.hough_circle_peaks(votes[:1], [5], 4, 1)
    assert (peaks.row.tolist(), peaks.column.tolist()) == ([4], [2])


def test_no_votes_have_no_peaks(backend):
    peaks = cvkern.hough_circle_peaks(np.zeros((3, 20, 30)), [3, 4, 5])
    assert [a.shape for a in peaks] == [(0,)] * 4


DIRECTED = [
    lambda mask, angles: cvkern.hough_circle(mask, 3, orientation=angles),
    lambda mask, angles: cvkern.hough_ellipse(mask, orientation=angles),
]


@pytest.mark.parametrize("value", [np.nan, np.inf, 7.0])
@pytest.mark.parametrize("function", DIRECTED)
def test_directions_that_are_none(backend, function, value):
    mask, angles = np.zeros((9, 8)), np.zeros((9, 8), np.float32)
    mask[2, 3] = 1
    angles[0, 0] = value  # where the mask is not set
    function(mask, angles)
    angles[2, 3] = value
    rule = "orientation must be in [-6.28319, 6.28319] where the mask is set"
    with pytest.raises(ValueError, match="orientation") as info:
        function(mask, angles)
    assert str(info.value) == f"{rule}, got {value:g} at (2, 3)"
