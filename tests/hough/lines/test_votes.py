"""Votes for lines: against float64 and scikit-image, and their properties."""

import re
from typing import Any

import cv2
import numpy as np
import pytest
import skimage.data
import skimage.transform
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from cvkern.hough.lines._tables import direction_windows
from tests.hough.lines import reference_lines as reference

HALF = np.pi / 2


def scattered(*shape, share=0.03, seed=0):
    return np.random.default_rng(seed).random(shape) < share


def normals(*shape, seed=1):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, shape).astype(np.float32)


def axes(shape, rho_step, theta):
    """Return factors and constant of the bins, and their number."""
    reach = int(np.ceil(np.hypot(*shape) / rho_step))
    return np.cos(theta) / rho_step, np.sin(theta) / rho_step, reach, 2 * reach + 1


def assert_between(votes, least_and_most):
    """Votes are all that are sure, and no more than those and what is near a tie."""
    least, most = least_and_most
    assert (votes >= least).all()
    assert (votes <= most).all()
    assert (least != most).mean() < 0.02  # the bounds are mostly equal


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (60, 1), (97, 143), (300, 40)])
@pytest.mark.parametrize(("rho_step", "number"), [(1.0, 180), (0.37, 91), (5.5, 13), (1.0, 1)])
def test_votes_are_those_of_float64(backend, shape, rho_step, number):
    mask = scattered(*shape)
    mask[0, 0] = True
    theta = np.random.default_rng(3).uniform(-4, 4, number)
    votes, got_theta, rho = cvkern.hough_line(mask, theta, rho_step=rho_step)
    cosine, sine, reach, rows = axes(shape, rho_step, theta)
    places = reference.bins(np.argwhere(mask), cosine, sine, reach)
    assert_between(votes, reference.least_and_most(places, rows))
    assert votes.dtype == np.int32
    assert votes.sum() == mask.sum() * number
    np.testing.assert_array_equal(got_theta, theta)
    np.testing.assert_allclose(rho, rho_step * (np.arange(rows) - reach), rtol=0, atol=1e-9)


def test_fixed_point_is_near_enough_in_the_largest_images(backend):
    """At the corners, where its error is largest: 24 million angles would find no worse."""
    mask = np.zeros((30000, 12), bool)
    mask[::29999, ::11] = True
    theta = np.linspace(-HALF, HALF, 1001)
    votes = cvkern.hough_line(mask, theta).votes
    cosine, sine, reach, rows = axes(mask.shape, 1.0, theta)
    places = reference.bins(np.argwhere(mask), cosine, sine, reach)
    assert_between(votes, reference.least_and_most(places, rows))


def test_scikit_images_votes(backend):
    mask = cv2.resize(skimage.data.camera(), (311, 233)) > 120
    mask ^= np.roll(mask, 1, 1)
    want, theta, rho = skimage.transform.hough_line(mask)
    got = cvkern.hough_line(mask)
    np.testing.assert_array_equal(got.theta, theta)
    np.testing.assert_array_equal(got.rho, rho)
    cosine, sine, reach, rows = axes(mask.shape, 1.0, theta)
    least, most = reference.least_and_most(
        reference.bins(np.argwhere(mask), cosine, sine, reach), rows
    )
    differ = got.votes != want
    # Scikit-image rounds ties away from 0, so the sides differ at ties and nowhere else.
    assert (least[differ] < most[differ]).all()
    assert differ.mean() < 1e-3


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.float32, np.float64])
def test_any_value_but_zero_votes(backend, dtype):
    mask = scattered(20, 30)
    np.testing.assert_array_equal(
        cvkern.hough_line(mask.astype(dtype) * 3).votes, cvkern.hough_line(mask).votes
    )


def test_empty_masks_and_lists_have_no_votes(backend):
    assert not cvkern.hough_line(np.zeros((9, 7))).votes.any()
    assert not cvkern.hough_line(points=np.zeros((0, 2)), shape=(9, 7)).votes.any()
    angles = np.zeros((9, 7))
    options: Any = {"orientation": angles, "weights": angles}
    assert not cvkern.hough_line(np.zeros((9, 7)), **options).votes.any()


def test_points_at_pixels_vote_as_the_mask(backend):
    mask = scattered(57, 83)
    points = np.argwhere(mask)
    want = cvkern.hough_line(mask, rho_step=0.7).votes
    got = cvkern.hough_line(points=points, shape=mask.shape, rho_step=0.7).votes
    np.testing.assert_array_equal(got, want)


def test_points_between_pixels(backend):
    rng = np.random.default_rng(4)
    shape = (57, 83)
    points = rng.uniform(-0.5, 1, (500, 2)) * np.array(shape).clip(max=np.array(shape) - 0.5)
    points = np.round(points.clip(-0.5, np.array(shape) - 0.5) * 4096) / 4096
    theta = np.linspace(-HALF, HALF, 60, endpoint=False)
    cosine, sine, reach, rows = axes(shape, 0.25, theta)
    got = cvkern.hough_line(None, theta, points=points, shape=shape, rho_step=0.25).votes
    places = reference.bins(points, cosine, sine, reach)
    assert_between(got, reference.least_and_most(places, rows))


@pytest.mark.parametrize("tolerance", [0.0, 0.004, 0.02, 0.3, HALF])
@pytest.mark.parametrize("number", [1, 7, 180])
def test_directed_votes(backend, tolerance, number):
    mask, orientation = scattered(48, 61, share=0.2), normals(48, 61)
    theta = np.linspace(-HALF, HALF, number, endpoint=False)
    got = cvkern.hough_line(
        mask, theta, orientation=orientation, orientation_tolerance=tolerance
    ).votes
    # The direction that counts is the nearest of 8192 over half a turn.
    direction = reference.half_turn_codes(orientation[mask]) * (np.pi / 8192)
    apart = np.abs((np.subtract.outer(direction, theta) + HALF) % np.pi - HALF)
    allowed = apart <= tolerance + 1e-9
    none = ~allowed.any(axis=1)
    allowed[none, apart[none].argmin(axis=1)] = True
    cosine, sine, reach, rows = axes(mask.shape, 1.0, theta)
    places = reference.bins(np.argwhere(mask), cosine, sine, reach)
    least, most = reference.least_and_most(places, rows, allowed)
    if number > 1:  # no direction is midway between two angles: either would be right
        assert (np.diff(np.sort(apart, axis=1)[:, :2]) > 1e-6).all()
    assert (got >= least).all()
    assert (got <= most).all()
    assert got.sum() == allowed.sum()


def test_directions_out_of_reach_do_not_vote(backend):
    """Angles from 0 to 40 degrees in steps of 4: half a step beyond them there are no votes."""
    theta = np.radians(np.arange(0, 41, 4.0))
    mask = np.ones((1, 5), bool)
    orientation = np.radians([[-1.9, -2.1, 21, 41.9, 42.1]])
    votes = cvkern.hough_line(mask, theta, orientation=orientation).votes
    np.testing.assert_array_equal(votes.sum(axis=0), [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])


def test_both_directions_across_a_line_are_one(backend):
    mask, orientation = scattered(30, 40), normals(30, 40)
    turned = orientation + np.where(orientation > 0, -np.pi, np.pi).astype(np.float32)
    one, other = (
        cvkern.hough_line(mask, orientation=a, orientation_tolerance=0.1).votes
        for a in (orientation, turned)
    )
    # Turning rounds in float32, by less than 2^-22, and may move one direction in 8192 by a code.
    assert np.abs(one - other).sum() <= 0.01 * one.sum()


def test_weights(backend):
    mask, orientation = scattered(48, 61), normals(48, 61)
    weights = np.random.default_rng(5).uniform(0, 9, mask.shape).astype(np.float32)
    theta = np.linspace(-HALF, HALF, 45, endpoint=False)
    cosine, sine, reach, rows = axes(mask.shape, 1.0, theta)
    fixed = np.floor(weights[mask].astype(np.float64) * 256 + 0.5).astype(int)
    places = reference.bins(np.argwhere(mask), cosine, sine, reach)
    got = cvkern.hough_line(mask, theta, weights=weights).votes
    assert_between(got, reference.least_and_most(places, rows, weights=fixed))
    directed = cvkern.hough_line(mask, theta, weights=weights, orientation=orientation).votes
    assert directed.sum() == fixed.sum()
    listed = cvkern.hough_line(
        None, theta, points=np.argwhere(mask), shape=mask.shape, weights=weights[mask],
        orientation=orientation[mask],
    ).votes  # fmt: skip
    np.testing.assert_array_equal(listed, directed)


def test_what_is_at_other_pixels_does_not_matter(backend):
    mask, orientation = scattered(20, 30), normals(20, 30)
    weights = np.where(mask, 1, -5).astype(np.float32)
    options: Any = {"orientation": np.where(mask, orientation, np.nan), "weights": weights}
    plain = cvkern.hough_line(mask, orientation=orientation).votes
    np.testing.assert_array_equal(cvkern.hough_line(mask, **options).votes, 256 * plain)


@given(st.integers(1, 40), st.integers(1, 60), st.integers(0, 2**16), st.floats(0.3, 7))
def test_every_point_votes_once_an_angle(height, width, seed, rho_step):
    mask = scattered(height, width, share=0.2, seed=seed)
    votes = cvkern.hough_line(mask, rho_step=rho_step).votes
    np.testing.assert_array_equal(votes.sum(axis=0), np.full(180, mask.sum()))


def test_swapping_the_axes_mirrors_theta(backend):
    mask = scattered(60, 90)
    theta = np.radians(np.arange(-90, 90) + 0.123)  # no pixel of these is near a tie
    votes = cvkern.hough_line(mask, theta).votes
    swapped = cvkern.hough_line(mask.T, HALF - theta[::-1]).votes
    np.testing.assert_array_equal(swapped[:, ::-1], votes)


def test_a_quarter_turn_of_the_image_moves_theta(backend):
    """From (x, y) to (y, W - 1 - x): theta by 90 degrees, and rho to (W - 1) cos(theta) - rho."""
    mask = np.zeros((120, 160), bool)
    y, x = np.mgrid[:120, :160]
    for angle, distance in ((0.3, 80), (-1.0, -20), (1.2, 90)):
        mask |= np.abs(x * np.cos(angle) + y * np.sin(angle) - distance) < 0.5
    before = cvkern.hough_line_peaks(*cvkern.hough_line(mask), num_peaks=3)
    after = cvkern.hough_line_peaks(*cvkern.hough_line(np.rot90(mask)), num_peaks=3)
    for theta, rho in zip(before.theta, before.rho, strict=True):
        moved, distance = theta + HALF, 159 * np.cos(theta) - rho
        turn = np.round((after.theta - moved) / np.pi)
        away = np.abs(after.theta - moved - np.pi * turn) / np.radians(1)
        off = np.abs(after.rho * (-1) ** turn - distance)
        assert ((away < 1.01) & (off < 2)).any()  # the next bin, where two are nearly equal


def test_lines_under_noise(backend):
    rng = np.random.default_rng(6)
    truth = [(0.3, 70.0), (-1.2, -60.0), (1.45, 110.0), (-HALF + 0.01, -30.0)]
    mask = rng.random((150, 200)) < 0.03
    y, x = np.mgrid[:150, :200]
    for theta, rho in truth:
        on = np.abs(x * np.cos(theta) + y * np.sin(theta) - rho) < 0.5
        mask |= on & (rng.random(mask.shape) < 0.7)
    peaks = cvkern.hough_line_peaks(*cvkern.hough_line(mask), refine=True)
    assert len(peaks.rho) == len(truth)
    for theta, rho in truth:
        turn = np.round((peaks.theta - theta) / np.pi)
        off = np.hypot(100 * (peaks.theta - theta - np.pi * turn), peaks.rho * (-1) ** turn - rho)
        assert off.min() < 2  # a degree is 1.7 here, a pixel 1


def test_slopes_and_intercepts(backend):
    mask = scattered(41, 67)
    mask[7, :] = mask[:, 12] = True
    slopes = np.linspace(-1, 1, 24)  # no simple fractions, which would make many ties
    h = cvkern.hough_line_slope(mask, slopes)
    y, x = np.nonzero(mask)
    ones = np.ones(len(slopes))
    for votes, points in ((h.votes, np.stack([y, x], 1)), (h.swapped, np.stack([x, y], 1))):
        places = reference.bins(points, -slopes, ones, -h.intercepts[0])
        assert_between(votes, reference.least_and_most(places, len(h.intercepts)))
        np.testing.assert_array_equal(votes.sum(axis=0), np.full(len(slopes), mask.sum()))
    np.testing.assert_array_equal(h.slopes, slopes)
    flat = np.abs(slopes).argmin()
    # The slope nearest to 0 is 1 / 23, and rises by 2.9 over the image.
    assert h.intercepts[h.votes[:, flat].argmax()] == pytest.approx(7, abs=3)
    assert h.intercepts[h.swapped[:, flat].argmax()] == pytest.approx(12, abs=3)


def test_slopes_within_chosen_intercepts(backend):
    mask = scattered(41, 67)
    slopes, every = np.linspace(-1, 1, 24), np.arange(-80, 130.5, 0.75)
    whole = cvkern.hough_line_slope(mask, slopes, every)
    part = cvkern.hough_line_slope(mask, slopes, every[60:110])
    np.testing.assert_array_equal(part.votes, whole.votes[60:110])
    np.testing.assert_array_equal(part.swapped, whole.swapped[60:110])
    beyond = cvkern.hough_line_slope(mask, slopes, np.arange(500, 510.0))
    assert not beyond.votes.any()


def test_windows_of_directions_are_cyclic():
    theta = np.linspace(-HALF, HALF, 180, endpoint=False)
    first, number = direction_windows(theta.tobytes(), np.radians(2))
    assert set(number) <= {4, 5}
    assert first[0] == 88  # 0 degrees: -2 to 2
    assert first[4096] == 178  # 90 degrees, which is -90: 88 and 89, then -90 to -88


def test_bins_from_the_error_of_edges():
    step, theta = cvkern.suggest_line_bins((1080, 1920), 0.1, length=500)
    assert step == pytest.approx(0.28)
    spacing = np.diff(theta)
    # A line midway between two angles leaves its bin at its ends, not before.
    assert 500 / 2 * spacing[0] / 2 == pytest.approx(step / 2, rel=0.01)
    np.testing.assert_allclose(spacing, np.pi / len(theta))


@pytest.mark.parametrize("width", [0.5, 2.8, 12.0])
def test_suggested_bins_stand_out_most(width):
    """Of bins so many standard deviations wide, the suggested have the most signal to noise."""
    rng = np.random.default_rng(7)
    rho = rng.normal(0, 1, 100_000)

    def standing_out(w):
        return (np.abs(rho) < w / 2).sum() / np.sqrt(w)

    suggested = cvkern.suggest_line_bins((100, 100), 1.0).rho_step
    assert standing_out(suggested) >= standing_out(width)


# ------------------------------------------------------------------- refused once points are known


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("orientation", np.nan, "orientation must be finite at the points, got nan"),
        ("orientation", -np.inf, "orientation must be finite at the points, got -inf"),
        ("weights", -0.5, "weights must be >= 0 and finite at the points, got -0.5"),
        ("weights", np.nan, "weights must be >= 0 and finite at the points, got nan"),
        ("weights", 1e7, "weights must be small enough for votes below 2^31, got up to 1e+07"),
    ],
)
def test_values_at_points_are_checked(backend, name, wrong, message):
    mask = scattered(20, 30)
    values: Any = np.ones(mask.shape, np.float32)
    values[tuple(np.argwhere(mask)[3])] = wrong
    with pytest.raises(ValueError, match=re.escape(message)):
        cvkern.hough_line(mask, **{name: values})
    if name == "orientation":
        with pytest.raises(ValueError, match=re.escape(message)):
            cvkern.hough_line_segments(mask, [0.0], [3.0], orientation=values)


def test_weights_that_no_bin_can_add_up_to_too_much(backend):
    """The sum of all exceeds int32; a line crosses no more than 100 pixels, twice."""
    mask = np.ones((100, 100), bool)
    weights = np.full(mask.shape, 2**31 / 256 / 201, np.float32)
    votes = cvkern.hough_line(mask, weights=weights).votes
    assert (votes >= 0).all()
    assert votes.sum(dtype=np.int64) > 2**31


def test_values_are_not_checked_within_a_capture(backend):
    mask, orientation = scattered(20, 30), normals(20, 30)
    calls: Any = ({"orientation": orientation}, {"weights": np.abs(orientation)})
    for options in calls:
        with pytest.raises(ValueError, match="captured functions must be kernels alone"):
            cvkern.capture(cvkern.hough_line, mask, **options)


# --- bins of any width ---------------------------------------------------------------------------


@pytest.mark.parametrize("step", [2.0**33, 2.0**34, 1e30, 3e38])
def test_bins_far_wider_than_the_image(backend, step):
    """All points are in the middle bin: tables in fixed point must not pass 62 bits."""
    mask = np.ones((4, 199), bool)
    votes, _, rho = cvkern.hough_line(mask, rho_step=step)
    np.testing.assert_array_equal(votes, np.array([[0], [mask.sum()], [0]]) + np.zeros((1, 180)))
    np.testing.assert_array_equal(rho, [-step, 0, step])
    points = np.argwhere(mask)[::7] + 0.25
    got = cvkern.hough_line(points=points, shape=mask.shape, rho_step=step).votes
    assert got[1].min() == got.max() == len(points)
    h = cvkern.hough_line_slope(mask, [0, 0.5], [0, step])
    for chart in (h.votes, h.swapped):
        np.testing.assert_array_equal(chart, [[mask.sum()] * 2, [0, 0]])


def test_bins_that_are_too_fine_or_endless_are_refused(no_kernel_runs):
    for step in (5e-324, 1e-300, 1e-10):
        with pytest.raises(ValueError, match=r"^votes must have at most 536870912 elements, got "):
            cvkern.hough_line(np.ones((4, 199)), rho_step=step)
    with pytest.raises(ValueError, match=r"^intercepts must be two or more, evenly spaced and asc"):
        cvkern.hough_line_slope(np.ones((4, 199)), [0], [0, np.inf])


def test_intercepts_too_close_for_a_single_pixel():
    with pytest.raises(ValueError, match=r"^intercepts must be at least 2\^-31 apart, got 1e-30$"):
        cvkern.hough_line_slope(np.ones((1, 1)), [0, 0.5], [0, 1e-30])
