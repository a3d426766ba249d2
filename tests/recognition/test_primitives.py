"""The primitives of recognition have exactly the numbers of plain code."""

import numpy as np
import pytest

from cvkern.kernels.codes.recognition import Frame, Occurrences, Patches, Space, Window
from tests.primitives import F32, I32, U8
from tests.recognition import reference_recognition as reference

I8, I64 = np.int8, np.int64


@pytest.mark.parametrize("side", [8, 16, 25])
def test_patches(kernels, side):
    image = np.random.default_rng(side).normal(0.5, 0.4, (40, 51)).astype(F32)
    image[:, 26:] = 0.25  # flat
    image[5, 49] = 0.75  # in a patch whose largest value is cut off
    corners = np.array([(r, c) for r in (0, 3, 40 - side) for c in (0, 7, 26, 51 - side)], I32)
    pixels = reference.rounded(image)
    size = -(-side * side // 32) * 32
    patches = [pixels[r : r + side, c : c + side].astype(I64) for r, c in corners]
    squares = [side**2 * (x**2).sum() - x.sum() ** 2 for x in patches]
    least = int(np.sqrt(min(s for s in squares if s > 0)))  # the contrast that one patch just has
    found = kernels(
        "recognition.patches.sample_patches", image, corners, side, least,
        out=[((len(corners), size), I8)],
    )  # fmt: skip
    want = reference.normalised(image, corners, side, least)
    np.testing.assert_array_equal(found[:, : side * side], want)
    assert not found[:, side * side :].any()
    assert not want.any(axis=1).all()
    assert want.max() == 127


@pytest.mark.parametrize(
    ("count", "words", "size", "most"),
    [(1, 1, 64, 1), (37, 130, 256, 4), (20, 3, 640, 8), (3, 0, 64, 2), (17, 64, 96, 5)],
)
def test_words(kernels, count, words, size, most):
    rng = np.random.default_rng(count)
    patches = rng.integers(-127, 128, (count, size)).astype(I8)
    book = rng.integers(-127, 128, (words, size)).astype(I8)
    book[words // 2 :] = book[: words - words // 2]  # ties
    least = 10_000
    found = kernels(
        "recognition.codebook.match_words", patches, book, least, out=[((count, most), I32)] * 2
    )
    for a, b in zip(found, reference.best_words(patches, book, least, most), strict=True):
        np.testing.assert_array_equal(a, b)


def test_clusters(kernels):
    rng = np.random.default_rng(0)
    patches = rng.integers(-90, 91, (41, 64)).astype(I8)
    sums = kernels("recognition.codebook.multiply_pairs", patches, out=[((41, 41), I64)])
    np.testing.assert_array_equal(sums, patches.astype(I64) @ patches.astype(I64).T)
    sizes = rng.integers(0, 3, 41).astype(I32)
    stale = rng.integers(0, 2, 41).astype(I32)
    least = 1000
    found = kernels(
        "recognition.codebook.find_partners", sums, sizes, least, stale,
        out=[np.full(41, 77, I32)],
    )  # fmt: skip
    for i in range(41):
        mean = {
            j: sums[i, j] / (int(sizes[i]) * int(sizes[j]))
            for j in range(41)
            if j != i and sizes[i] and sizes[j]
        }
        best = max(mean, key=lambda j: (mean[j], -j), default=-1)
        want = best if best >= 0 and mean[best] >= least else -1
        assert found[i] == (want if stale[i] and sizes[i] else 77)
    pairs = np.array([[1, 5], [0, 40], [7, 6]], I32)
    merged, total = kernels(
        "recognition.codebook.merge_clusters", pairs, out=[sums.copy(), np.ones(41, I32)]
    )
    members = [[i] for i in range(41)]
    for a, b in pairs.tolist():
        members[a].append(b)
    for i in set(range(41)) - {5, 40, 6}:
        assert total[i] == len(members[i])
        for j in set(range(41)) - {5, 40, 6}:
            assert merged[i, j] == sums[np.ix_(members[i], members[j])].sum()
    assert not total[[5, 40, 6]].any()


def scene(seed=0):
    """Return patches of two levels, occurrences of words, and an accumulator of two bins."""
    rng = np.random.default_rng(seed)
    places, rows, levels = [], [], []
    for z, step in ((0, 64), (32, 96)):
        first = len(rows)
        for y in range(100, 900, step):
            begin = len(places)
            places += [(y, x, z) for x in range(110 + y % 7, 1300, step)]
            rows.append((y, begin, len(places)))
        levels.append((z, first, len(rows)))
    matches = rng.integers(-1, 12, (len(places), 3))
    matches = -np.sort(-matches, axis=1)  # none is behind the others
    starts = np.r_[0, np.cumsum(rng.integers(0, 5, 12))]
    entries = np.column_stack(
        [rng.integers(-300, 300, (starts[-1], 2)), rng.integers(-40, 41, starts[-1]),
         rng.integers(0, 2**16, starts[-1])]
    )  # fmt: skip
    entries[::5, 2], entries[1::5, 2] = 16, -16  # votes halfway between both bins
    bins = np.array([(0, 15, 21, 0, 64), (315, 11, 15, 32, 91)], I32)
    scales = np.arange(-80, 120)
    factors = np.array([reference.factor(z) for z in scales], I32)
    patches = Patches(*(np.array(a, I32) for a in (places, rows, levels, matches)))
    return (
        patches,
        Occurrences(starts.astype(I32), entries.astype(I32)),
        Space(bins, 20, factors, -80),
    )


def cast(kernels, patches, occurrences, space, maxima=None, window=None):
    """Return sums, starts and votes: all, or those near maxima."""
    cells = int((space.bins[:, 1] * space.bins[:, 2]).sum())
    sums, counts = kernels(
        "recognition.votes.count_votes", patches, occurrences, space,
        out=[((cells,), I32)] * 2,
    )  # fmt: skip
    starts = np.r_[0, np.cumsum(counts)].astype(I32)
    if maxima is not None:
        starts = kernels(
            "recognition.votes.mark_votes", maxima, space, window, counts,
            out=[((cells + 1,), I32)],
        )  # fmt: skip
    count = int(starts[-1])
    votes = kernels(
        "recognition.votes.list_votes", patches, occurrences, space, starts,
        out=[((count, 4), I32)],
    )  # fmt: skip
    return sums, starts, votes


@pytest.mark.parametrize("half", [False, True])
def test_votes(kernels, half):
    """With patches of half the size, many votes are exactly halfway between two places."""
    patches, occurrences, space = scene()
    if half:
        patches.places[:, 2] -= 64
        patches.levels[:, 0] -= 64
        occurrences.entries[:, 2] += 64
    sums, starts, votes = cast(kernels, patches, occurrences, space)
    want = reference.votes(patches.places, patches.matches, *occurrences, space.bins, space.slack)
    assert len(want) > 1000
    np.testing.assert_array_equal(sums, np.bincount(want[:, 0], want[:, 4], len(sums)))
    np.testing.assert_array_equal(
        starts[1:], np.cumsum(np.bincount(want[:, 0], minlength=len(sums)))
    )
    assert_same_votes(starts, votes, want)


def assert_same_votes(starts, votes, want):
    """Compare votes by their cells; within a cell they are in any order."""
    cell = np.searchsorted(starts, np.arange(len(votes)), side="right") - 1
    found, want = (a[np.lexsort(a.T)] for a in (np.column_stack([cell, votes]), want[:, :5]))
    np.testing.assert_array_equal(found, want)


def test_votes_near_maxima(kernels):
    patches, occurrences, space = scene(6)
    maxima = np.array([(410, 600, 0, 9), (20, 1300, 32, 1), (800, 90, 32, 0)], I32)
    window = Window(90, 15, 6)  # with the slack of 20, it reaches both bins
    _, starts, votes = cast(kernels, patches, occurrences, space, maxima, window)
    want = reference.votes(patches.places, patches.matches, *occurrences, space.bins, space.slack)
    near = np.zeros(len(starts) - 1, bool)
    for first, rows, columns, _, side in space.bins.tolist():
        row, column = np.divmod(np.arange(rows * columns), columns)
        for y, x, _, value in maxima.tolist():
            apart = np.maximum(abs(row - y // side), abs(column - x // side))
            near[first : first + rows * columns] |= (apart <= 3) & (value > 0)
    want = want[near[want[:, 0]]]
    assert 0.02 < near.mean() < 0.5
    np.testing.assert_array_equal(np.diff(starts), np.bincount(want[:, 0], minlength=len(near)))
    assert_same_votes(starts, votes, want)


def test_modes(kernels):
    patches, occurrences, space = scene(1)
    sums, starts, votes = cast(kernels, patches, occurrences, space)
    tiles = np.array(
        [(s, r, c, min(r + 4, rows), min(c + 5, columns))
         for s, (_, rows, columns, _, _) in enumerate(space.bins.tolist())
         for r in range(0, rows, 4) for c in range(0, columns, 5)], I32
    )  # fmt: skip
    maxima = kernels(
        "recognition.votes.find_maxima", sums, space, tiles, out=[((len(tiles), 4), I32)]
    )
    np.testing.assert_array_equal(maxima, reference.maxima(sums, space.bins, tiles))
    window = Window(90, 25, 6)
    modes = kernels(
        "recognition.votes.shift_modes", votes, starts, space, window, maxima,
        out=[(maxima.shape, I32)],
    )  # fmt: skip
    listed = reference.votes(patches.places, patches.matches, *occurrences, space.bins, space.slack)
    moved = 0
    for start, found in zip(maxima.tolist(), modes.tolist(), strict=True):
        if start[3] > 0:
            assert tuple(found) == reference.mode(listed, start[:3], *window)
            moved += found[:3] != start[:3]
        else:
            assert found == [-1, -1, -1, 0]
    assert moved > len(tiles) // 2


def test_evidence(kernels):
    patches, _, space = scene(2)
    rng = np.random.default_rng(3)
    layers = np.array([(150, 260, 3, 5, 0, 0), (90, 110, 1, 4, 32, 15)], I32)
    frame = Frame(layers, 120, 300)
    weights = rng.integers(-9999, 9999, (12, 19)).astype(I32)
    modes = np.column_stack(
        [rng.integers(0, 900, 12), rng.integers(0, 1300, 12), rng.integers(-9, 50, 12), np.ones(12)]
    ).astype(I32)
    modes[1] = modes[0] + (20, 30, 0, 0)
    halfway, rest = divmod(int(patches.levels[:2, 0].sum()), 2)
    assert rest == 0  # two levels are equally near: the first one counts
    modes[2:5] = [
        (y, x, halfway - z, 1) for y, x, z in ((450, 600, 0), (300, 800, 0), (500, 700, 32))
    ]
    found = kernels(
        "recognition.hypotheses.weigh_evidence", patches, weights, space, frame, modes,
        out=[((12,), I32)],
    )  # fmt: skip
    levels = patches.levels[:, 0]
    given = patches.places, patches.matches, levels, weights, frame
    want = [reference.evidence(*given, m) for m in modes.tolist()]
    np.testing.assert_array_equal(found, want)
    shared = kernels(
        "recognition.hypotheses.weigh_overlaps", patches, weights, space, frame, modes,
        out=[((12, 12), I32)],
    )  # fmt: skip
    want = [[reference.evidence(*given, a, b) for b in modes.tolist()] for a in modes.tolist()]
    np.testing.assert_array_equal(shared, want)
    assert np.count_nonzero(shared) > 20


def test_figures(kernels):
    patches, occurrences, space = scene(4)
    figures = np.random.default_rng(5).integers(0, 256, (len(occurrences.entries), 25)).astype(U8)
    window, frame = Window(120, 40, 6), Frame(np.zeros((0, 6), I32), 100, 250)
    modes = np.array([(500, 600, 0, 1), (300, 200, 32, 1), (700, 900, 11, 1)], I32)
    shape = (3, 40, 50)
    balance = kernels(
        "recognition.figures.paint_figures", patches, occurrences, space, window, frame, figures,
        modes, out=[(shape, I32)],
    )  # fmt: skip
    listed = reference.votes(patches.places, patches.matches, *occurrences, space.bins, space.slack)
    masks = kernels(
        "recognition.figures.spread_figures", balance, modes, space, out=[((3, 60, 80), U8)]
    )
    for mode, box, mask in zip(modes.tolist(), balance, masks, strict=True):
        want = reference.balance(listed, patches.places, figures, mode, window, frame, shape[1:])
        assert (want != 0).sum() > 100
        np.testing.assert_array_equal(box, want)
        np.testing.assert_array_equal(mask, reference.mask(box, mode, (60, 80)))
    assert 0.01 < masks.mean() < 0.5
