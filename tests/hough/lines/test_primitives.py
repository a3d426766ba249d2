"""The primitives of points and lines against NumPy."""

from typing import Any

import numpy as np
import pytest

from cvkern.hough.lines._tables import direction_windows, line_tables, reach
from cvkern.kernels.codes.hough import DIRECTIONS, LineWindows, most_peaks
from tests.hough.lines import reference_lines as lines_reference
from tests.primitives import F32, I32, U8, noise


def line_votes(angles, number=300, seed=3, size=(90, 130)):
    """Return the arguments of a vote for lines: points, their count, and tables."""
    rng = np.random.default_rng(seed)
    mask = np.zeros(size, bool)
    mask.ravel()[rng.choice(mask.size, number, replace=False)] = True
    theta = np.sort(rng.uniform(-1.5, 1.5, angles))
    tables = line_tables(theta.tobytes(), 1.0, size, 1)
    counted = np.array([0, number], I32)
    spare = np.full((number + 5, 2), -9, I32)  # beyond the count there is anything
    spare[:number] = np.argwhere(mask)
    return mask, spare, counted, theta, tables


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (9, 64), (300, 217), (257, 48)])
def test_count_and_gather(kernels, shape):
    mask = (np.random.default_rng(1).random(shape) < 0.2) * U8(7)
    starts = kernels("hough.points.count", mask, out=[((shape[0] + 1,), I32)])
    np.testing.assert_array_equal(starts, np.append(0, np.cumsum((mask > 0).sum(1))))
    want = np.argwhere(mask)
    points = kernels("hough.points.gather", mask, starts, out=[((len(want) + 1, 2), I32)])
    np.testing.assert_array_equal(points[: len(want)], want)


def test_first_outside(kernels):
    mask, points, counted, _, _ = line_votes(3)
    values = noise(*mask.shape)
    for place in (300, 120, 7):
        if place < 300:
            values[tuple(points[place])] = np.nan
        (first,) = kernels("hough.points.first_outside", points, counted, values, -9.0, 9.0,
                           out=[((1,), I32)])  # fmt: skip
        assert first == place


@pytest.mark.parametrize("angles", [1, 7, 8, 33])
@pytest.mark.parametrize("weighted", [False, True])
def test_votes_for_lines(kernels, angles, weighted):
    mask, points, counted, theta, tables = line_votes(angles)
    rows = 2 * int(np.ceil(np.hypot(*mask.shape))) + 1
    rng = np.random.default_rng(5)
    weights = rng.integers(0, 999, len(points)).astype(I32)
    cast = weights if weighted else np.ones_like(weights)
    given = tables, weights if weighted else None
    got = kernels("hough.lines.votes.vote", points, counted, *given, out=[((rows, angles), I32)])
    want = lines_reference.vote(points[:300], tables, None, None, cast, rows, angles)
    np.testing.assert_array_equal(got, want)

    turned = rng.uniform(-4, 4, len(points)).astype(F32)
    windows = direction_windows(theta.tobytes(), 0.2)
    got = kernels(
        "hough.lines.votes.vote_directed", points, counted, LineWindows(turned, *windows), *given,
        out=[((rows, angles), I32)],
    )  # fmt: skip
    codes = lines_reference.half_turn_codes(turned)
    want = lines_reference.vote(points[:300], tables, windows, codes, cast, rows, angles)
    np.testing.assert_array_equal(got, want)


def test_votes_in_more_bins_than_a_block_holds(kernels):
    """On CUDA the histogram of an angle is then cut into parts."""
    size = (13000, 3)
    tables = line_tables(np.linspace(-1.5, 1.5, 5).tobytes(), 1.0, size, 1)
    points = np.stack([np.arange(0, 13000, 9), np.arange(0, 13000, 9) % 3], 1).astype(I32)
    counted = np.array([len(points)], I32)
    weights = np.ones(len(points), I32)
    got = kernels("hough.lines.votes.vote", points, counted, tables, None, out=[((26003, 5), I32)])
    want = lines_reference.vote(points, tables, None, None, weights, 26003, 5)
    np.testing.assert_array_equal(got, want)


def test_take(kernels):
    mask, points, counted, _, _ = line_votes(3)
    values = noise(*mask.shape)
    got = kernels("hough.lines.votes.take", points, counted, values, out=[((len(points),), F32)])
    np.testing.assert_array_equal(got[:300], values[mask])


@pytest.mark.parametrize("dtype", [I32, F32])
@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize(("sizes", "shape", "most"), [
    ((0, 0), (33, 21), 15), ((2, 3), (33, 21), 15), ((40, 5), (33, 21), 15),
    ((1, 3), (65, 12), 99), ((3, 2), (65, 12), 99),  # where half a turn decides some
])  # fmt: skip
def test_local_maxima(kernels, dtype, wraps, sizes, shape, most):
    values = np.random.default_rng(1).integers(0, most, shape).astype(dtype)
    got = kernels(
        "hough.lines.peaks.local_maxima", values, 6, *sizes, wraps, out=[(values.shape, U8)]
    )
    want = lines_reference.local_maxima(values, 6, sizes[0], sizes[1], wraps)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize(
    ("angles", "step", "apart"), [(1, 1.0, (1, 1)), (7, 1.0, (2, 3)), (719, 0.1, (3, 3))]
)
def test_lines_with_many_votes(kernels, angles, step, apart):
    """Some lines are near half a turn, where rho changes its sign; the last are several slabs."""
    mask, points, counted, _, _ = line_votes(1)
    theta = np.linspace(-np.pi / 2, np.pi / 2, angles, endpoint=False)
    tables = line_tables(theta.tobytes(), step, mask.shape, 1)
    points[:200, 0] -= points[:200, 0] % 20  # five rows, and so peaks
    turned = np.random.default_rng(5).uniform(-4, 4, len(points)).astype(F32)
    turned[:200] = np.pi / 2 + 0.1 * turned[:200]
    windows = direction_windows(theta.tobytes(), 0.2)
    shape = 2 * reach(mask.shape, step) + 1, angles
    capacity = most_peaks(shape, apart)
    keys, total = kernels(
        "hough.lines.peaks.find_lines", points, counted, LineWindows(turned, *windows), tables,
        shape, 3, apart, out=[((capacity,), np.int64), ((1,), I32)],
    )  # fmt: skip
    codes, ones = lines_reference.half_turn_codes(turned), np.ones(len(points), I32)
    votes = lines_reference.vote(points[:300], tables, windows, codes, ones, shape[0], angles)
    found = np.flatnonzero(lines_reference.local_maxima(votes, 3, apart[0], apart[1], True))
    want = (2**31 - 1 - votes.ravel()[found].astype(np.int64) << 32) + found
    assert 2 < len(want) < capacity
    np.testing.assert_array_equal(np.sort(keys[: total[0]]), np.sort(want))


@pytest.mark.parametrize("number", [1, 64, 333])
def test_claim(kernels, number):
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 300, (number, 2)).astype(F32)
    codes = rng.integers(0, DIRECTIONS, number).astype(I32)
    theta = rng.uniform(-1.6, 1.6, 50)
    lines = np.stack([np.cos(theta), np.sin(theta), rng.uniform(-99, 300, 50)]).astype(F32)
    directions = rng.integers(0, DIRECTIONS, 50).astype(I32)
    after = rng.integers(-1, 30, number).astype(I32)
    given: Any = points, codes, after, lines, directions, 12.0, 2500
    got = kernels("hough.lines.segments.claim", *given, out=[((number,), I32)])
    cosine, sine, rho = lines
    want = lines_reference.claim(points, codes, after, cosine, sine, rho, directions, 12.0, 2500)
    np.testing.assert_array_equal(got, want)


def test_claim_on_bounds(kernels):
    """Points at the distance and the tolerance, lines just after `after`, and a point outside."""
    y, x = np.mgrid[:40:4, :40:4].reshape(2, -1)
    points = np.append(np.stack([y, x], 1), [[-1, -1]], 0).astype(F32)
    root = np.sqrt(0.5)
    lines = np.array([[1, 0, root], [0, 1, root], [8, 20, -2 * root - 11.9]], F32)
    directions, tolerance = np.array([0, 100, 9000], I32), 2500
    off = np.array([tolerance, -tolerance, tolerance + 1, -tolerance - 1, 0])
    for k in range(3):
        codes = ((directions[k] + np.resize(off, len(points))) % DIRECTIONS).astype(I32)
        codes[-1] = directions[2]
        after = np.resize([-1, -1, -1, 0, -1, 1, 2], len(points)).astype(I32)
        after[-1] = 0  # line 1 is just after, and has another direction
        given: Any = points, codes, after, lines, directions, 12.0, tolerance
        got = kernels("hough.lines.segments.claim", *given, out=[(after.shape, I32)])
        cosine, sine, rho = lines
        want = lines_reference.claim(
            points, codes, after, cosine, sine, rho, directions, 12.0, tolerance
        )
        np.testing.assert_array_equal(got, want)
        assert got[-1] == 2
