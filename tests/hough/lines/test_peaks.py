"""Peaks among the votes for lines: against scikit-image and a plain search."""

import numpy as np
import pytest
import skimage.transform
from skimage.draw import line

import cvkern
from cvkern._runtime import runtime
from cvkern.hough.lines.peaks import peak_bins
from tests.hough.lines import reference_lines as reference

HALF = np.pi / 2


def drawing(seed, lines=6, noise=0.01):
    rng = np.random.default_rng(seed)
    mask = rng.random((180, 240)) < noise
    for _ in range(lines):
        y, x = rng.integers(0, 180, 2), rng.integers(0, 240, 2)
        mask[line(y[0], x[0], y[1], x[1])] = True
    return mask


@pytest.mark.parametrize("seed", range(5))
def test_clear_peaks_are_scikit_images(backend, seed):
    h = skimage.transform.hough_line(drawing(seed))
    want = skimage.transform.hough_line_peaks(*h, num_peaks=3, threshold=60)
    got = cvkern.hough_line_peaks(*h, num_peaks=3, threshold=60)
    assert len(want[0])
    for a, b in zip(got, want, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("sizes", [(0, 0), (3, 2), (9, 5), (50, 9)])
def test_peaks_are_the_first_largest_of_their_windows(backend, dtype, wraps, sizes):
    values = np.random.default_rng(1).integers(0, 12, (41, 18)).astype(dtype)  # with many ties
    theta = np.linspace(0, np.pi if wraps else 1, 18, endpoint=False)
    down, along = sizes
    mask = reference.local_maxima(values, 5, down, along, wraps)
    got = cvkern.hough_line_peaks(values, theta, np.arange(41.0), down, along, threshold=5)
    row, column = np.nonzero(mask)
    order = np.argsort(-values[row, column], kind="stable")
    np.testing.assert_array_equal(got.votes, values[row, column][order])
    np.testing.assert_array_equal(got.rho, row[order])
    np.testing.assert_array_equal(got.theta, theta[column[order]])
    assert len(got.rho)


def test_a_line_at_the_end_of_theta_is_found_once(backend):
    """Midway between -90 degrees and 89: its votes are at both ends, with opposite rho."""
    y, x = np.mgrid[:100, :200]
    angle = -HALF - np.radians(0.5)
    mask = np.abs(x * np.cos(angle) + y * np.sin(angle) + 60) < 0.6
    h = cvkern.hough_line(mask)
    assert min(h.votes[:, 0].max(), h.votes[:, -1].max()) > 60
    peaks = cvkern.hough_line_peaks(*h, threshold=60)
    assert len(peaks.rho) == 1


def test_refinement_finds_lines_between_the_bins(backend):
    """Votes of a ridge that is a parabola in either direction come back exactly."""
    theta, rho = np.linspace(-HALF, HALF, 60, endpoint=False), np.arange(-80.0, 81)
    for t0, r0 in ((20.3, 100.4), (40.0, 30.0), (59.4, 71.8), (0.2, 90.1)):
        dt = (np.arange(60) - t0 + 30) % 60 - 30
        turned = np.abs(np.arange(60) - t0) > 30  # on the other side, rho has the other sign
        dr = np.arange(161)[:, None] - np.where(turned, 160 - r0, r0)
        votes = (900 - 2.0 * dt**2 - 3.0 * dr**2).astype(np.float32)
        peaks = cvkern.hough_line_peaks(votes, theta, rho, threshold=800, refine=True)
        assert len(peaks.rho) == 1
        step = np.pi / 60
        t, r = (peaks.theta[0] - theta[0]) / step, peaks.rho[0] + 80
        if abs(t - t0) > 30:
            t, r = t - 60 * np.sign(t - t0), 160 - r
        # The votes are at most 900 in float32, so rounded by 3e-5, and the parabola bends by 4.
        assert t == pytest.approx(t0, abs=1e-4)
        assert r == pytest.approx(r0, abs=1e-4)


def test_refinement_at_the_edge_of_the_accumulator(backend):
    votes = np.zeros((5, 4), np.float32)
    votes[0, 0], votes[1, 0] = 9, 6
    theta = np.array([0, 0.1, 0.2, 0.3])
    peaks = cvkern.hough_line_peaks(votes, theta, np.arange(5.0), 1, 1, refine=True)
    assert (peaks.theta[0], peaks.rho[0]) == (0, 0)


def test_nothing_stands_out_of_nothing(backend):
    h = cvkern.hough_line(np.zeros((20, 30)))
    for refine in (False, True):
        peaks = cvkern.hough_line_peaks(*h, refine=refine)
        assert [len(a) for a in peaks] == [0, 0, 0]


def test_number_and_threshold(backend):
    h = cvkern.hough_line(drawing(0))
    every = cvkern.hough_line_peaks(*h, threshold=20)
    assert len(every.rho) > 4
    assert (np.diff(every.votes) <= 0).all()
    few = cvkern.hough_line_peaks(*h, threshold=20, num_peaks=3)
    for a, b in zip(few, every, strict=True):
        np.testing.assert_array_equal(a, b[:3])
    # Above the threshold, not at it; and by default half of the largest.
    strict = cvkern.hough_line_peaks(*h, threshold=float(every.votes[2])).votes
    assert strict.min() > every.votes[2]
    halves = cvkern.hough_line_peaks(*h).votes
    assert halves.min() > every.votes[0] / 2


def test_fractions_of_a_vote_as_a_threshold(backend):
    votes = np.array([[0, 3, 0, 0, 0, 2]], np.int32)
    angles, dists = np.arange(6) * 0.1, [0.0]
    for threshold, number in ((1.5, 2), (2, 1), (2.5, 1), (2.99, 1), (3, 0), (-1.5, 2)):
        found = cvkern.hough_line_peaks(votes, angles, dists, 0, 1, threshold=threshold)
        assert (found.votes > 1).sum() == number


def test_smoothed_votes_are_welcome(backend):
    h = cvkern.hough_line(drawing(2))
    smooth = cvkern.gaussian(h.votes, 1)
    peaks = cvkern.hough_line_peaks(smooth, h.theta, h.rho, num_peaks=1)
    assert peaks.votes.dtype == np.float32
    assert peaks.votes[0] == smooth.max()


def test_bins_of_peaks_in_kernel_memory(backend):
    votes = np.random.default_rng(3).integers(0, 99, (30, 20)).astype(np.int32)
    rt = runtime(votes)
    row, column = peak_bins(rt, rt.adopt(votes, np.int32), 50, 2, 2, True)
    want = reference.local_maxima(votes, 50, 2, 2, True)
    assert len(row) == want.sum()
    assert want[row, column].all()


@pytest.mark.parametrize("limit", [2**31, 1e12, 3e38])
def test_thresholds_beyond_int32_are_above_all_votes(backend, limit):
    votes, theta, rho = cvkern.hough_line(drawing(1))
    assert len(cvkern.hough_line_peaks(votes, theta, rho, threshold=limit).votes) == 0
    below = cvkern.hough_line_peaks(votes, theta, rho, threshold=-limit)
    assert len(below.votes) == len(cvkern.hough_line_peaks(votes, theta, rho, threshold=-1).votes)


def test_votes_beyond_int32_are_refused():
    votes = np.array([[2**31, 1], [1, 0]])
    with pytest.raises(ValueError, match=r"^hspace must be votes that int32 holds, got 2147483648"):
        cvkern.hough_line_peaks(votes, [0.0, 0.1], [0.0, 1.0])


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1)])
def test_refinement_of_a_single_row_or_column(backend, shape):
    votes = np.zeros(shape, np.int32)
    votes[shape[0] // 2, shape[1] // 2] = 7
    theta, rho = np.arange(shape[1]) * 0.1, np.arange(shape[0]) * 1.0
    found = cvkern.hough_line_peaks(votes, theta, rho, threshold=1, refine=True)
    np.testing.assert_allclose(found.theta, theta[shape[1] // 2])
    np.testing.assert_allclose(found.rho, rho[shape[0] // 2])


def test_a_plateau_has_no_top_to_move_to(backend):
    """Where a bin and both its neighbours are equal, the parabola is flat."""
    theta, rho = np.linspace(-1.5, 1.4, 5), np.arange(4.0)
    found = cvkern.hough_line_peaks(np.full((4, 5), 7.0), theta, rho, 0, 0, 1.0, refine=True)
    assert len(found.votes) == 20
    np.testing.assert_array_equal(np.sort(found.theta), np.sort(np.tile(theta, 4)))
    np.testing.assert_array_equal(np.sort(found.rho), np.sort(np.tile(rho, 5)))
