"""Runs of points along lines against NumPy, which sorts, cuts and adds them in its own way."""

import math

import numpy as np
import pytest

from cvkern.kernels.codes.hough import DENSITY, DIRECTION_FACTOR, DIRECTIONS
from tests.primitives import F32, I32, U8

F64 = np.float64


def scattered(number, lines, seed=0):
    """Return points near lines with labels; the last label is that of points on no line."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(-1.5, 1.5, lines)
    labels = rng.integers(0, lines + 1, number).astype(I32)
    along = rng.integers(0, 60, number) * rng.choice([1.0, 1.0, 4.0], number)
    angle = np.append(theta, 0.3)[labels]
    y, x = 40 * np.sin(angle) + along * np.cos(angle), 40 * np.cos(angle) - along * np.sin(angle)
    points = np.stack([y, x], axis=1).astype(F32) + rng.normal(0, 0.2, (number, 2)).astype(F32)
    points[: number // 4] = points[number // 4 : number // 4 * 2]  # some are in the same place
    directions = rng.uniform(-math.pi, math.pi, number).astype(F32)
    return points, directions, codes_of(directions), labels, theta


def codes_of(angles):
    turned = np.asarray(angles, F32) * F32(DIRECTION_FACTOR) + F32(0.5)
    return (np.floor(turned).astype(np.int64) & (DIRECTIONS - 1)).astype(I32)


def cut(points, codes, labels, theta, max_gap, least):
    """Return the sorted points, and begin and number of the runs that are kept."""
    along = np.zeros(len(points))
    on = labels < len(theta)
    y, x = points[on].astype(F64).T
    along[on] = y * np.cos(theta)[labels[on]] - x * np.sin(theta)[labels[on]]
    away = (codes - np.append(codes_of(theta), 0)[labels]) % DIRECTIONS
    bright = (away < DIRECTIONS // 4) | (away >= DIRECTIONS * 3 // 4)
    group = np.where(on, 2 * labels + bright, 2 * len(theta))
    order = np.lexsort((np.floor(along * 2**14 + 0.5), group))
    runs = []
    for g in np.unique(group[on]):
        places = np.flatnonzero(group[order] == g)
        breaks = np.flatnonzero(np.diff(along[order][places]) > max_gap) + 1
        for part in np.split(places, breaks):
            length = along[order[part[-1]]] - along[order[part[0]]]
            if length >= least and len(part) >= DENSITY * length:
                runs.append((part[0], len(part)))
    return order, np.array(runs, I32).reshape(-1, 2)


@pytest.mark.parametrize(("number", "lines"), [(1, 1), (2, 1), (700, 5), (4097, 40)])
@pytest.mark.parametrize(("max_gap", "least"), [(3.0, 10.0), (0.5, 0.7)])
def test_runs(kernels, number, lines, max_gap, least):
    points, directions, codes, labels, theta = scattered(number, lines)
    exact = np.stack([np.cos(theta), np.sin(theta)])
    given = points, codes, labels, exact, codes_of(theta), (max_gap, least)
    out = [((2 * number,), I32), ((number, 2), I32), ((number,), U8), ((1,), I32)]
    order, runs, chosen, total = kernels("hough.lines.runs.cut", *given, out=out)
    want_order, want = cut(points, codes, labels, theta, max_gap, least)
    np.testing.assert_array_equal(order[:number], want_order)
    np.testing.assert_array_equal(runs[: total[0]], want)
    members = [want_order[begin : begin + size] for begin, size in want]
    np.testing.assert_array_equal(np.flatnonzero(chosen), np.sort(np.concatenate([[], *members])))
    if number < 100:
        return
    assert 3 < len(want) < number
    pair = want_order.astype(I32), want
    sums = kernels(
        "hough.lines.runs.add_up", points, directions, *pair, out=[((len(want), 8), F64)]
    )
    angle = theta[: len(want)] if len(want) <= lines else np.resize(theta, len(want))
    normal = np.stack([np.cos(angle), np.sin(angle)])
    ends = kernels("hough.lines.runs.reach", points, *pair, normal, out=[((len(want), 2), F64)])
    for s, of_run in enumerate(members):
        place = points[of_run].astype(F64)
        apart = place - place[0]
        np.testing.assert_array_equal(sums[s, :3], [*place[0], directions[of_run[0]]])
        # A run has up to 400 points: 400 roundings, each 2^-53 of the sum of magnitudes.
        terms = *apart.T, *apart.T**2, apart[:, 0] * apart[:, 1]
        for got, term in zip(sums[s, 3:], terms, strict=True):
            assert abs(got - math.fsum(term)) <= 400 * 2**-53 * np.abs(term).sum()
        at = place[:, 0] * normal[0, s] - place[:, 1] * normal[1, s]
        np.testing.assert_array_equal(ends[s], [at.min(), at.max()])


def test_runs_on_bounds(kernels):
    """The largest gap does not cut; a run of the least length and density is kept."""
    for top, max_gap, least in (
        (np.repeat(np.arange(0, 13, 3), 2), 3.0, 12.0),  # 10 points, more than dense enough
        (np.array([0, 2, 4, 6, 8, 10]), 2.0, 1.0),  # DENSITY times a length of 10 is 6
        (np.array([0, 2, 5]), 3.0, 5.0),
    ):
        number, theta = len(top), np.zeros(1)
        points = np.stack([top, np.full(number, 5.0)], axis=1).astype(F32)
        codes, labels = codes_of(np.zeros(number)), np.zeros(number, I32)
        out = [((2 * number,), I32), ((number, 2), I32), ((number,), U8), ((1,), I32)]
        given = points, codes, labels, np.array([[1.0], [0.0]]), codes_of(theta), (max_gap, least)
        _, runs, _, total = kernels("hough.lines.runs.cut", *given, out=out)
        assert cut(points, codes, labels, theta, max_gap, least)[1].tolist() == [[0, number]]
        assert runs[: total[0]].tolist() == [[0, number]]


def test_points_are_prepared_and_left(kernels):
    points, directions, codes, labels, _ = scattered(999, 7)
    out = [((999, 2), I32), ((999,), I32)]
    fixed, coded = kernels("hough.lines.runs.prepare", points, directions, 4096.0, out=out)
    np.testing.assert_array_equal(fixed, np.floor(points.astype(F64) * 4096 + 0.5))
    np.testing.assert_array_equal(coded, codes)
    chosen = (np.random.default_rng(1).random(999) < 0.4).astype(U8)
    after = kernels("hough.lines.runs.hold", labels, chosen, out=[((999,), I32)])
    np.testing.assert_array_equal(after, np.where(chosen, labels - 1, -1))
    out = [((999, 2), F32), ((999,), F32), ((1,), I32)]
    left, turned, total = kernels("hough.lines.runs.keep", points, directions, chosen, out=out)
    np.testing.assert_array_equal(left[: total[0]], points[chosen == 0])
    np.testing.assert_array_equal(turned[: total[0]], directions[chosen == 0])


def test_values_of_bins(kernels):
    rng = np.random.default_rng(2)
    bins = rng.integers(0, 20, (50, 2)).astype(I32)
    for values in (rng.integers(0, 2**31 - 1, (20, 20)).astype(I32), rng.random((20, 20), F32)):
        got = kernels("hough.lines.peaks.take", values, bins, out=[((50,), F64)])
        np.testing.assert_array_equal(got, values[tuple(bins.T)].astype(F64))
