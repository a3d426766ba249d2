"""The primitives of circles and ellipses against NumPy, and the sets against each other."""

import numpy as np
import pytest

from cvkern.hough.circles.votes import _rings, direction_table
from cvkern.kernels.codes.hough import (
    ARCS,
    DIRECTION_FACTOR,
    DIRECTIONS,
    FINE_ONE,
    LINE_ONE,
    NORMAL_ONE,
    Aim,
    EllipseBounds,
)
from tests.hough.circles import reference_circles as reference
from tests.primitives import F32, I32, U8, noise, waves

I64 = np.int64
RADII = (3, 9, 9, 20)


def specks(*shape, share=0.2, seed=0):
    return (np.random.default_rng(seed).random(shape) < share).astype(U8)


def lines_of(count=3000, height=90, width=120, seed=0):
    """Points with directions, in the order of their rows but for half a pixel."""
    rng = np.random.default_rng(seed)
    row = np.sort(rng.integers(0, height, count)) + rng.uniform(-0.5, 0.5, count)
    column, angle = rng.uniform(0, width - 1, count), rng.uniform(-np.pi, np.pi, count)
    return np.stack((row, column, np.sin(angle), np.cos(angle))).astype(F32)


@pytest.mark.parametrize("pad", [0, 20])
@pytest.mark.parametrize("shape", [(1, 1), (7, 40), (37, 29), (20, 530)])
def test_vote_rings(kernels, shape, pad):
    mask = specks(*shape)
    rings = _rings(RADII)
    offsets, starts = rings.offsets, rings.starts
    padded = np.pad(mask, pad + 20).astype(I32)
    height, width = shape[0] + 2 * pad, shape[1] + 2 * pad
    want = np.zeros((len(RADII), height, width), I32)
    for i in range(len(RADII)):
        for dy, dx in offsets[starts[i] : starts[i + 1]]:
            want[i] += padded[20 + dy : 20 + dy + height, 20 + dx : 20 + dx + width]
    given = mask, rings, max(RADII)
    np.testing.assert_array_equal(
        kernels("hough.circles.votes.vote_rings", *given, out=[(want.shape, I32)]), want
    )
    shares = kernels("hough.circles.votes.vote_rings", *given, out=[(want.shape, F32)])
    np.testing.assert_array_equal(
        shares, want.astype(F32) / np.diff(starts).astype(F32)[:, None, None]
    )


def directed(mask, tolerance):
    points = np.argwhere(mask).astype(I32)
    rows = np.searchsorted(points[:, 0], np.arange(len(mask) + 1)).astype(I32)
    angles = (6.2 * np.random.default_rng(1).random(mask.shape) - 3.1).astype(F32)
    return (points, rows, angles, _rings(RADII), direction_table(), tolerance), angles


@pytest.mark.parametrize("pad", [0, 20])
def test_vote_directed(kernels, pad):
    mask = specks(41, 53)
    given, angles = directed(mask, -1)
    want = reference.directed(mask, angles, RADII, pad)
    got = kernels("hough.circles.votes.vote_directed", *given, out=[(want.shape, I32)])
    np.testing.assert_array_equal(got, want)


def test_directions_at_the_tolerance(kernels):
    """A point votes for offsets that are just within its tolerance, and for none a code beyond."""
    rings, tolerance = _rings((9,)), 700
    mask = np.zeros((1, 4 * len(rings.codes)), U8)
    mask[0] = 1
    off = np.array([tolerance, -tolerance, tolerance + 1, -tolerance - 1])
    codes = (rings.codes[:, None] + off).ravel() % DIRECTIONS
    angles = ((codes - DIRECTIONS * (codes > DIRECTIONS // 2)) / DIRECTION_FACTOR).astype(F32)
    given = np.argwhere(mask).astype(I32), np.array([0, mask.size], I32), angles[None]
    shape = (1, 19, mask.size + 18)
    want = np.zeros(shape, I32)
    for x, code in enumerate(codes):
        for turn in (0, DIRECTIONS // 2):
            apart = (rings.codes - code - turn + tolerance) % DIRECTIONS
            down, along = rings.offsets[apart <= 2 * tolerance].T
            np.add.at(want, (0, 9 + down, 9 + x + along), 1)
    got = kernels(
        "hough.circles.votes.vote_directed", *given, rings, direction_table(), tolerance,
        out=[(shape, I32)],
    )  # fmt: skip
    np.testing.assert_array_equal(got, want)


def test_peaks(kernels):
    votes = np.round(3 * noise(3, 40, 70)).astype(F32)  # with many ties
    # Peaks in the last column and the last row, with more votes where memory goes on.
    votes[:, 20, -1], votes[:, 21, 0], votes[0, -1, 30], votes[1, 0, 30] = 18, 19, 18, 19
    limits = np.array([2, 5, 100], F32)
    tops = kernels("hough.circles.peaks.row_maxima", votes, out=[((120,), F32)])
    np.testing.assert_array_equal(tops, votes.max(axis=2).ravel())
    for down, along in ((1, 1), (2, 5), (50, 90)):
        want = []
        for p, y, x in np.argwhere(votes > limits[:, None, None]):
            top, left = max(y - down, 0), max(x - along, 0)
            window = votes[p, top : y + down + 1, left : x + along + 1]
            if np.unravel_index(window.argmax(), window.shape) == (y - top, x - left):
                want.append((p, y, x))
        want = np.array(want, I32).reshape(-1, 3)
        given = votes, limits, down, along
        counts = kernels("hough.circles.peaks.count_peaks", *given, out=[((120,), I32)])
        rows = 40 * want[:, 0] + want[:, 1]
        np.testing.assert_array_equal(counts, np.bincount(rows, minlength=120))
        starts = np.append(0, np.cumsum(counts)).astype(I32)
        places, values = kernels(
            "hough.circles.peaks.gather_peaks",
            *given,
            starts,
            out=[(want.shape, I32), ((len(want),), F32)],
        )
        np.testing.assert_array_equal(places, want)
        np.testing.assert_array_equal(values, votes[tuple(want.T)])


@pytest.mark.parametrize("dtype", [U8, F32])
@pytest.mark.parametrize("factor", [1, 3, 5])
def test_shrink(kernels, dtype, factor):
    image = np.random.default_rng(0).integers(0, 256, (41, 67)).astype(dtype)
    height, width = 41 // factor, 67 // factor
    got = kernels("hough.circles.detection.shrink", image, factor, out=[((height, width), F32)])
    whole = image[: factor * height, : factor * width].reshape(height, factor, width, factor)
    # Sums of such integers are exact; they are multiplied by a rounded share.
    want = whole.sum(axis=(1, 3), dtype=F32) * (F32(1) / F32(factor * factor))
    np.testing.assert_array_equal(got, want)


def test_aim(kernels):
    dy, dx = waves(60, 80)
    pixels = np.argwhere(np.hypot(dy, dx) > 0.5).astype(I32)
    assert len(pixels) > 500
    lines = kernels("hough.circles.detection.aim", dy, dx, pixels, out=[((4, len(pixels)), F32)])
    length = np.pad(np.sqrt(dx * dx + dy * dy), 1).astype(float)
    y, x = pixels.T
    steep = np.abs(dy[y, x]) > np.abs(dx[y, x])
    before, here, behind = (length[y + 1 + s * steep, x + 1 + s * ~steep] for s in (-1, 0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = 0.5 * (before - behind) / (before - 2 * here + behind)
    offset = np.where((here > before) & (here >= behind), offset, 0)
    # The quotient of differences of lengths that are each right to 2^-24 of about 1.
    np.testing.assert_allclose(lines[0], y + offset * steep, atol=1e-4, rtol=0)
    np.testing.assert_allclose(lines[1], x + offset * ~steep, atol=1e-4, rtol=0)
    np.testing.assert_allclose(lines[2:], (dy[y, x] / here, dx[y, x] / here), rtol=3e-7)


@pytest.mark.parametrize("sides", [(1, -1), (1, 1), (-1, -1)])
@pytest.mark.parametrize("cell", [1, 3])
def test_vote_centers(kernels, sides, cell):
    lines, (low, high) = lines_of(), (4, 25)
    shape = -(-90 // cell), -(-120 // cell)
    want = np.zeros(shape, F32)
    scale = F32(LINE_ONE / cell)
    y, x = (np.floor(a * scale + F32(0.5)).astype(int) + LINE_ONE // 2 for a in lines[:2])
    dy, dx = (lines[2:] * F32(LINE_ONE)).astype(int)
    for side in {*sides}:
        within = np.ones(len(y), bool)
        for k in range(low, high + 1):
            row, column = (y + side * k * dy) // LINE_ONE, (x + side * k * dx) // LINE_ONE
            inside = (row >= 0) & (column >= 0) & (row < shape[0]) & (column < shape[1])
            within &= inside  # a line ends where it leaves; what begins outside has no votes
            np.add.at(want, (row[within], column[within]), 1)
    got = kernels(
        "hough.circles.detection.vote_centers", lines, low, high, float(scale), *sides,
        out=[(shape, F32)],
    )  # fmt: skip
    np.testing.assert_array_equal(got, want)


def seen(lines, row, column, slack, slope, sides):
    """Offsets and distances of the points that aim at a place, in float32."""
    dy, dx = lines[0] - row, lines[1] - column
    far = np.sqrt(dy * dy + dx * dx)
    aside, ahead = dy * lines[3] - dx * lines[2], dy * lines[2] + dx * lines[3]
    turned = ((ahead < 0) & (sides[0] > 0)) | ((ahead > 0) & (sides[1] < 0))
    kept = turned & (np.abs(aside) <= F32(slack) + F32(slope) * far)
    return dy, dx, far, kept


@pytest.mark.parametrize("sides", [(1, -1), (1, 1), (-1, -1)])
def test_vote_radii(kernels, sides):
    lines = lines_of()
    centers = np.array([[40.5, 60.25], [0, 0], [89, 10], [300, 300]], F32)
    got = kernels(
        "hough.circles.detection.vote_radii", lines, centers, 5.0, 30.0, 1.0,
        Aim(2.0, 0.25, *sides), out=[((4, 26), I32)],
    )  # fmt: skip
    for center, counts in zip(centers, got, strict=True):
        _, _, far, kept = seen(lines, center[0], center[1], 2.0, 0.25, sides)
        kept &= (far >= 5) & (far <= 30)
        want = np.bincount((far[kept] - F32(5)).astype(int), minlength=26)
        np.testing.assert_array_equal(counts, want)
    assert got[0].sum() > 20
    assert not got[3].any()


def test_support(kernels):
    lines = lines_of()
    circles = np.array([[40.5, 60.25, 20], [5, 5, 30], [300, 300, 9]], F32)
    sums, arcs = kernels(
        "hough.circles.detection.support", lines, circles, 6.0, Aim(2.0, 0.25, 1, -1),
        out=[((3, 9), I64), ((3, ARCS), I32)],
    )  # fmt: skip
    for (row, column, radius), found, parts in zip(circles, sums, arcs, strict=True):
        dy, dx, far, kept = seen(lines, row, column, 2.0, 0.25, (1, -1))
        kept &= (far >= radius - F32(6)) & (far <= radius + F32(6))
        dy, dx, far = dy[kept], dx[kept], far[kept]
        ny, nx = (np.floor(d / far * F32(NORMAL_ONE) + F32(0.5)).astype(I64) for d in (dy, dx))
        e = np.floor((far - radius) * F32(FINE_ONE) + F32(0.5)).astype(I64)
        terms = ny * ny, ny * nx, nx * nx, ny, nx, np.ones_like(e), e * ny, e * nx, e
        np.testing.assert_array_equal(found, [t.sum() for t in terms])
        ay, ax = np.abs(dy), np.abs(dx)
        octant = (dy < 0) + 2 * (dx < 0) + 4 * (ay > ax)
        step = (np.minimum(ay, ax) / np.maximum(ay, ax) * F32(ARCS // 8)).astype(int)
        part = octant * (ARCS // 8) + np.minimum(step, ARCS // 8 - 1)
        np.testing.assert_array_equal(parts, np.bincount(part, minlength=ARCS))
    assert sums[0, 5] > 20


@pytest.mark.parametrize("sides", [(1, -1), (1, 1), (-1, -1)])
def test_points_on_bounds(kernels, sides):
    """At both distances, square to the gradient, on diagonals, and in the centre."""
    y, x = np.mgrid[:61, :61:3].reshape(2, -1)
    turn = np.arange(y.size) % 4
    lines = np.stack((y, x, np.take([0, 1, 0, -1], turn), np.take([1, 0, -1, 0], turn))).astype(F32)
    aim, middle = Aim(40.0, 0.0, *sides), np.array([[30, 30]], F32)
    got = kernels(
        "hough.circles.detection.vote_radii", lines, middle, 5.0, 30.0, 1.0, aim,
        out=[((1, 26), I32)],
    )  # fmt: skip
    dy, dx, far, kept = seen(lines, F32(30), F32(30), 40.0, 0.0, sides)
    inside = kept & (far >= 5) & (far <= 30)
    want = np.bincount((far[inside] - F32(5)).astype(int), minlength=26)
    assert want[0] > 0 and want[-1] > 0  # noqa: PT018
    np.testing.assert_array_equal(got[0], want)
    sums, parts = kernels(
        "hough.circles.detection.support", lines, np.array([[30, 30, 6]], F32), 6.0, aim,
        out=[((1, 9), I64), ((1, ARCS), I32)],
    )  # fmt: skip
    kept &= (far > 0) & (far <= 12)
    assert sums[0, 5] == kept.sum()
    ay, ax = np.abs(dy[kept]), np.abs(dx[kept])
    octant = (dy[kept] < 0) + 2 * (dx[kept] < 0) + 4 * (ay > ax)
    step = (np.minimum(ay, ax) / np.maximum(ay, ax) * (ARCS // 8)).astype(int)
    part = octant * (ARCS // 8) + np.minimum(step, ARCS // 8 - 1)
    np.testing.assert_array_equal(parts[0], np.bincount(part, minlength=ARCS))


def test_the_sets_give_equal_bits(all_kernels):
    mask, lines = specks(60, 80, share=0.05), lines_of(200)
    shape, pairs = (len(RADII), 60, 80), (200, 200)

    def results(call):
        for tolerance in (-1, 0, 3, 700, 4095):
            given, _ = directed(mask, tolerance)
            for dtype in (I32, F32):
                yield call("hough.circles.votes.vote_directed", *given, out=[(shape, dtype)])
        # Points on a lattice are at both bounds of length, and on the circles about pairs.
        lattice = np.stack((*np.mgrid[:100:10, :200:10].reshape(2, -1), *lines[2:])).astype(F32)
        for points, turn in ((lines, -1.0), (lines, 0.04), (lines, 0.5), (lattice, -1.0)):
            given = EllipseBounds(100.0, 5000.0, 4.0, 900.0, 1.0, turn), 32
            yield from call(
                "hough.ellipses.votes.vote_pairs", points, *given, out=[(pairs, I32), (pairs, I32)]
            )
        dy, dx = waves(50, 60)
        pixels = np.argwhere(np.hypot(dy, dx) > 0.5).astype(I32)
        yield call("hough.circles.detection.aim", dy, dx, pixels, out=[((4, len(pixels)), F32)])

    first, *others = [list(results(call)) for call in all_kernels]
    assert all(a.any() for a in first)
    for found in others:
        for a, b in zip(first, found, strict=True):
            np.testing.assert_array_equal(a.view(f"u{a.itemsize}"), b.view(f"u{b.itemsize}"))
