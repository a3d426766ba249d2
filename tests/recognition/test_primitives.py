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
    firsts = np.column_stack([corners @ (51, 1), np.full(len(corners), 51)]).astype(I32)
    found = kernels(
        "recognition.patches.sample_patches", image.ravel(), firsts, side, least,
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
        "recognition.modes.find_maxima", sums, space, tiles, out=[((len(tiles), 4), I32)]
    )
    np.testing.assert_array_equal(maxima, reference.maxima(sums, space.bins, tiles))
    window = Window(90, 25, 6)
    modes = kernels(
        "recognition.modes.shift_modes", votes, starts, space, window, maxima,
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
    modes = np.array([(3, 0, 0, 0), (500, 600, 0, 1), (300, 200, 32, 1), (700, 900, 11, 1)], I32)
    shape = (4, 40, 50)  # with room for one more than there are
    balance = kernels(
        "recognition.figures.paint_figures", patches, occurrences, space, window, frame, figures,
        modes, out=[(shape, I32)],
    )  # fmt: skip
    listed = reference.votes(patches.places, patches.matches, *occurrences, space.bins, space.slack)
    assert not balance[3].any()
    masks = kernels(
        "recognition.figures.spread_figures", balance, modes, space, out=[((3, 60, 80), U8)]
    )
    for mode, box, mask in zip(modes[1:].tolist(), balance[:3], masks, strict=True):
        want = reference.balance(listed, patches.places, figures, mode, window, frame, shape[1:])
        assert (want != 0).sum() > 100
        np.testing.assert_array_equal(box, want)
        np.testing.assert_array_equal(mask, reference.mask(box, mode, (60, 80)))
    assert 0.01 < masks.mean() < 0.5


def test_highest_maxima(kernels):
    rng = np.random.default_rng(7)
    for count, most, top in ((500, 40, 30), (30, 40, 30), (2000, 512, 2**31 - 1), (9, 4, 0)):
        values = rng.integers(-1, top, count, endpoint=True)
        maxima = np.column_stack([rng.integers(0, 99, (count, 3)), values]).astype(I32)
        found = kernels("recognition.modes.select_maxima", maxima, out=[((most, 4), I32)])
        order = np.argsort(-values, kind="stable")[:most]
        order = np.sort(order[values[order] > 0])
        np.testing.assert_array_equal(found[: len(order)], maxima[order])
        assert (found[len(order) :] == -1).all()


def test_single_modes(kernels):
    rng = np.random.default_rng(8)
    modes = np.column_stack(
        [rng.integers(0, 6, (300, 2)), rng.integers(-4, 5, 300), rng.integers(0, 4, 300)]
    ).astype(I32)
    spans = np.sort(rng.integers(-1, 7, (7, 2, 2)), axis=1).reshape(7, 4).astype(I32)
    for some in (spans, spans[:0]):
        want, seen = modes.copy(), set()
        for row in want:
            y, x, z, density = row.tolist()
            top, left, bottom, right = some[min(max(z + 3, 0), 6)] if len(some) else (0, 0, 9, 9)
            if not (
                top <= y <= bottom and left <= x <= right and density and (y, x, z) not in seen
            ):
                row[3] = 0
            if density:
                seen.add((y, x, z))
        found = kernels("recognition.modes.single_modes", modes, some, -3, out=[((300, 4), I32)])
        np.testing.assert_array_equal(found, want)
        assert 10 < np.count_nonzero(want[:, 3]) < np.count_nonzero(modes[:, 3]) - 10


def test_hypotheses_are_ranked_and_chosen(kernels):
    rng = np.random.default_rng(9)
    places = np.array([(y, x, z) for y in range(4) for x in range(4) for z in range(3)])
    places = rng.permutation(places)
    modes = np.column_stack([places, rng.integers(0, 3, 48)]).astype(I32)
    evidence = rng.integers(-5, 20, 48).astype(I32)
    order = [i for i in range(48) if modes[i, 3] and evidence[i] >= 2]
    order.sort(key=lambda i: (-int(evidence[i]), *places[i].tolist()))
    for most in (10, 40):
        ranked, savings = kernels(
            "recognition.choices.rank_modes", modes, evidence, 2,
            out=[((most, 4), I32), ((most,), I32)],
        )  # fmt: skip
        best = order[:most]
        np.testing.assert_array_equal(ranked[: len(best)], modes[best])
        np.testing.assert_array_equal(savings[: len(best)], evidence[best])
        assert not ranked[len(best) :].any()
    shared = rng.integers(-4, 6, (40, 40)).astype(I32)
    starts = np.array([0, 3, 77], I32)
    found = kernels(
        "recognition.choices.explain_modes", ranked, savings, shared, starts, 2,
        out=[((41, 4), I32)],
    )  # fmt: skip
    left = savings[: len(order)].tolist()
    want = []
    while max(left) >= 2:
        best = left.index(max(left))
        want.append((*ranked[best, :3].tolist(), left[best]))
        left = [a - max(int(b), 0) for a, b in zip(left, shared[:, best], strict=False)]
        left[best] = -1
    assert found[0].tolist() == [len(want), 77, 0, 0]
    assert found[1 : len(want) + 1].tolist() == [list(row) for row in want]
    assert len(want) > 3
    assert not found[len(want) + 1 :].any()


def test_objects_in_pixels(kernels):
    modes = np.array([(2, 0, 0, 0), (33, 999, -2, 70_001), (-5, 16, 90, -3)], I32)
    sizes = np.random.default_rng(1).random((5, 3)) * 50
    found = kernels(
        "recognition.figures.describe_objects", modes, sizes, -3, 2**20 + 1,
        out=[((2, 4), F32), ((2,), F32), ((2, 2), F32), ((2,), F32)],
    )  # fmt: skip
    own = sizes[[1, 4]]
    centers = modes[1:, :2] / 16
    boxes = np.concatenate([centers + 0.5 - own[:, 1:], centers + 0.5 + own[:, 1:]], axis=1)
    scores = (modes[1:, 3].astype(I64) + 2**20 + 1) / 2**14
    for a, b in zip(found, (boxes, scores, centers, own[:, 0]), strict=True):
        np.testing.assert_array_equal(a, b.astype(F32))
