"""The primitives of robust fits, against NumPy and SciPy."""

import numpy as np
import pytest
import scipy.optimize

from cvkern._runtime import runtime
from cvkern.geometry._matches import gather
from cvkern.kernels.codes.geometry import Draw, Given
from tests.geometry import reference_robust as reference

KINDS = {"similarity": 0, "affine": 1, "homography": 2}
F32, F64, I32, U8 = np.float32, np.float64, np.int32, np.uint8
PLANES = np.zeros((1, 9))  # for models that start from no plane
MAPS = (
    np.array([[0.8, -0.3, 0.1], [0.3, 0.8, -0.05], [0, 0, 1]]),
    np.array([[0.8, -0.2, 0.1], [0.35, 0.7, -0.05], [0, 0, 1]]),
    np.array([[0.8, -0.2, 0.1], [0.35, 0.7, -0.05], [0.1, -0.2, 1]]),
)


def pairs(kind, counts=(150, 33, 7), outliers=0.3, noise=0.004, seed=0):
    """Matches in the form of kernels, with gaps of numbers that must not be read as matches."""
    rng = np.random.default_rng(seed)
    starts = np.cumsum([0] + [-(-n // 32) * 32 for n in counts])
    matches = np.full((4, starts[-1]), 0.25, F32)
    for start, n in zip(starts[:-1], counts, strict=True):
        a = rng.uniform(-1, 1, (n, 2))
        q = np.c_[a, np.ones(n)] @ MAPS[kind].T
        b = q[:, :2] / q[:, 2:] + rng.normal(0, noise, (n, 2))
        wild = rng.random(n) < outliers
        b[wild] = rng.uniform(-1, 1, (wild.sum(), 2))
        matches[:, start : start + n] = np.c_[a, b].T
    spans = np.stack((starts[:-1], counts), 1).astype(I32)
    squares = np.array([0.02, 0.01, 0.03][: len(counts)], F32) ** 2
    return matches, spans, squares


def of(matches, span):
    return matches[:, span[0] : span[0] + span[1]]


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_propose(kernels, kind):
    matches, spans, squares = pairs(kind)
    chosen, seed, first, groups = np.array([2, 0, 1], I32), 5, 128, 3
    models, costs = kernels(
        "geometry.robust.propose", Given(matches, spans, squares, PLANES), chosen,
        Draw(kind, seed, first),
        out=[((3, groups, 9), F32), ((3, groups), I32)],
    )  # fmt: skip
    for row, pair in enumerate(chosen):
        given, square = of(matches, spans[pair]), squares[pair]
        for g in range(groups):
            best = reference.best_of_group(kind, seed, first + 64 * g, given, square)
            assert best is not None
            preview, _, right = best
            model = models[row, g]
            # Exactly what NumPy counts for this model, which is the best but for rounding.
            assert costs[row, g] == reference.cost(model, given, square)[0]
            assert reference.cost(model, given[:, :64], square)[0] == pytest.approx(preview, abs=64)
            scale = model[8] / right[8]
            np.testing.assert_allclose(
                model, right * scale, rtol=0, atol=2e-5 * np.abs(model).max()
            )


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_propose_has_no_model_for_degenerate_samples(kernels, kind):
    line = np.linspace(-1, 1, 32, dtype=F32)
    rng = np.random.default_rng(0).uniform(-1, 1, (2, 32)).astype(F32)
    wrong = [np.zeros((4, 32), F32), np.full((4, 32), np.nan, F32)]
    if kind:
        wrong += [np.stack((line, line, *rng)), np.stack((*rng, line, -line))]
    matches = np.concatenate(wrong, 1)
    spans = np.array([(32 * i, 32) for i in range(len(wrong))], I32)
    squares, chosen = np.full(len(wrong), 1e-4, F32), np.arange(len(wrong), dtype=I32)
    models, costs = kernels(
        "geometry.robust.propose", Given(matches, spans, squares, PLANES), chosen, Draw(kind, 0, 0),
        out=[((len(wrong), 2, 9), F32), ((len(wrong), 2), I32)],
    )  # fmt: skip
    assert (costs == reference.NO_COST).all()
    assert (models == 0).all()


def test_samples_have_no_match_twice():
    for hypothesis in range(300):
        for count in (4, 5, 9):
            picked = reference.sample(3, hypothesis, count, 4)
            assert picked is None or len(set(picked)) == 4
            assert picked is None or max(picked) < count


def test_choose(kernels):
    rng = np.random.default_rng(0)
    models = rng.normal(size=(4, 6, 9)).astype(F32)
    costs = rng.integers(0, 3, (4, 6)).astype(I32)  # many ties
    costs[3, 1:] = reference.NO_COST
    rows = np.array([3, 0, 2], I32)
    chosen = kernels("geometry.robust.choose", models, costs, rows, out=[((3, 3, 9), F64)])
    for i, row in enumerate(rows):
        order = np.argsort(costs[row], kind="stable")[:3]
        np.testing.assert_array_equal(chosen[i], models[row, order])


def refined(kernels, kind, start, schedule, noise=0.004):
    matches, spans, squares = pairs(kind, noise=noise)
    chosen = np.arange(3, dtype=I32)
    models = np.broadcast_to(start, (3, 2, 9)).astype(F64).copy()
    models, scores = kernels(
        "geometry.robust.refine", Given(matches, spans, squares, PLANES), chosen, kind,
        np.array(schedule, F32), out=[models, ((3, 2, 2), I32)],
    )  # fmt: skip
    return matches, spans, squares, models, scores[..., 0], scores[..., 1]


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_refine_is_least_squares(kernels, kind):
    start = MAPS[kind].ravel() + np.array([0.01, -0.01, 0.01, 0.01, 0.01, 0.01, 0, 0, 0])
    if kind == 0:
        start[4], start[3] = start[0], -start[1]
    matches, spans, squares, models, costs, supports = refined(
        kernels, kind, start, [9, 4, 2, 2, 2, 2, 2, 2]
    )
    for i in range(2):  # the third pair has too few
        given = of(matches, spans[i])
        h = models[i, 0]
        np.testing.assert_array_equal(models[i, 1], h)
        expected = reference.cost(h, given, squares[i])
        assert (costs[i, 0], supports[i, 0]) == expected
        near = reference.residuals(h, given) < 2 * squares[i]
        assert 0.5 * len(near) < near.sum() < len(near)

        def gaps(free, near=near, given=given):
            m = {0: lambda p: [p[0], -p[1], p[2], p[1], p[0], p[3], 0, 0, 1],
                 1: lambda p: [*p, 0, 0, 1], 2: lambda p: [*p, 1]}[kind](free)  # fmt: skip
            x, y, u, v = given[:, near].astype(F64)
            q = np.c_[x, y, np.ones(len(x))] @ np.reshape(m, (3, 3)).T
            return np.r_[q[:, 0] / q[:, 2] - u, q[:, 1] / q[:, 2] - v]

        free = h / h[8]
        free = {0: free[[0, 3, 2, 5]], 1: free[:6], 2: free[:8]}[kind]
        best = scipy.optimize.least_squares(gaps, free, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        # Gauss-Newton on noise of 0.004 has converged to a millionth of it.
        np.testing.assert_allclose(free, best.x, rtol=0, atol=1e-6)


def test_refine_keeps_what_is_better(kernels):
    """A step that makes a model worse is not taken; a model of nothing stays."""
    matches, spans, squares, models, costs, _ = refined(kernels, 2, np.zeros(9), [2, 2])
    assert (models == 0).all()
    assert costs[:, 0].tolist() == (spans[:, 1] * reference.COST_ONE).tolist()
    start = MAPS[2].ravel()
    _, _, _, models, costs, _ = refined(kernels, 2, start, [1e4, 1e4, 1e4])
    for i in range(3):
        before = reference.cost(start, of(matches, spans[i]), squares[i])[0]
        assert costs[i, 0] <= before + before // 16


@pytest.mark.parametrize(("number", "shift", "taken"), [(4, 1.1, True), (10, 1.5, False)])
def test_refine_may_cost_a_sixteenth_more(kernels, number, shift, taken):
    """Least squares move to outliers in symmetric places: by 5 % of the cost, and by 20 %."""
    y, x = np.mgrid[-1:1:10j, -1:1:10j].reshape(2, -1)
    u = x.copy()
    u[: number // 2] += 0.1 * shift
    u[100 - number // 2 :] += 0.1 * shift
    matches = np.pad(np.stack([x, y, u, y]), ((0, 0), (0, 28))).astype(F32)
    spans, squares = np.array([[0, 100]], I32), np.array([0.01], F32)
    models, _ = kernels(
        "geometry.robust.refine", Given(matches, spans, squares, PLANES), np.zeros(1, I32), 0,
        np.array([4], F32), out=[np.eye(3).reshape(1, 1, 9), ((1, 1, 2), I32)],
    )  # fmt: skip
    moved = number / 100 * 0.1 * shift if taken else 0
    assert models[0, 0, 2] == pytest.approx(moved, abs=1e-7)  # float32 of the matches


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_mark(kernels, kind):
    matches, spans, squares = pairs(kind)
    models = np.broadcast_to(MAPS[kind].ravel(), (3, 9)).astype(F64)
    marks = kernels(
        "geometry.robust.mark", Given(matches, spans, squares, PLANES), kind, models,
        out=[((matches.shape[1],), U8)],
    )  # fmt: skip
    for i in range(3):
        near = reference.residuals(models[i], of(matches, spans[i])) < squares[i]
        np.testing.assert_array_equal(of(marks[None], spans[i])[0], near)
    rest = np.ones(len(marks), bool)
    for start, count in spans:
        rest[start : start + count] = False
    assert (marks[rest] == 77).all()


def test_mark_leaves_out_what_is_just_as_far_as_the_threshold(kernels):
    x = np.array([0, 0, 0], F32)
    matches = np.pad(np.stack([x, x, np.array([0.5, 0.25, -0.5], F32), x]), ((0, 0), (0, 29)))
    given = Given(matches, np.array([[0, 3]], I32), np.array([0.25], F32), PLANES)
    found = kernels(
        "geometry.robust.mark", given, 0, np.eye(3).reshape(1, 9), out=[((32,), U8)]
    )  # fmt: skip
    assert found[:3].tolist() == [0, 1, 0]


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_equal_bits(all_kernels, kind):
    """Also of models in float64, in which the sets round alike."""
    matches, spans, squares = pairs(kind, (500, 96, 31), 0.5)
    chosen = np.arange(3, dtype=I32)
    schedule = np.array([9, 4, 2, 2], F32)
    given = Given(matches, spans, squares, PLANES)
    answers = []
    for kernels in all_kernels:
        models, costs = kernels(
            "geometry.robust.propose", given, chosen, Draw(kind, 9, 0),
            out=[((3, 8, 9), F32), ((3, 8), I32)],
        )  # fmt: skip
        best = kernels("geometry.robust.choose", models, costs, chosen, out=[((3, 4, 9), F64)])
        end = kernels(
            "geometry.robust.refine", given, chosen, kind, schedule, out=[best, ((3, 4, 2), I32)],
        )  # fmt: skip
        answers.append((models, costs, best, *end))
    assert_as_equal_as_can_be(*answers, on_gpu=all_kernels[0].device != "cpu")


def assert_as_equal_as_can_be(ones, others, *, on_gpu):
    """Compare in every bit, but for float64 on CUDA, where Taichi fuses products with sums.

    There the solution of 9 equations differs by 2^-53 times a number that their condition sets.
    """
    for one, other in zip(ones, others, strict=True):
        if on_gpu and one.dtype == F64:
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * np.abs(one).max())
        else:
            np.testing.assert_array_equal(one, other)


def test_gather(backend):
    rt = runtime(np.empty(0))
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0, 700, (2, 50, 2))
    a[7], b[9] = np.nan, np.inf
    a[20], b[20] = a[3], b[3]
    a[21], b[21] = a[3], b[4]
    a[0], b[0] = 0.0, -0.0
    empty = np.empty((0, 2))
    batch = gather(rt, [(a, b), (empty, empty), (a[:5], b[:5])])
    scaled = np.array(rt.to_numpy(batch.matches))
    assert batch.spans.tolist() == [[0, 47], [64, 0], [64, 5]]
    assert batch.places[[7, 9]].tolist() == [-1, -1]
    assert batch.places[20] == batch.places[3] != batch.places[21]
    for pair, rows in ((0, np.r_[0:7, 8, 10:50]), (2, np.arange(5))):
        offset = 50 if pair else 0
        for side, points in enumerate((a, b)):
            q = np.c_[points[rows, ::-1], np.ones(len(rows))] @ batch.to_unit[side, pair].T
            got = scaled[2 * side : 2 * side + 2, batch.places[offset + rows]]
            np.testing.assert_array_equal(got, q[:, :2].T.astype(F32))
            assert np.abs(got).max() <= 1
    order = rng.permutation(50)
    again = gather(rt, [(a[order], b[order])])
    np.testing.assert_array_equal(rt.to_numpy(again.matches)[:, :47], scaled[:, :47])
    np.testing.assert_array_equal(again.places, batch.places[:50][order])


@pytest.mark.parametrize("columns", [2, 3])
def test_matches_are_sorted_by_a_hash(kernels, columns):
    """Against NumPy's sort of splitmix64's mix; some matches are equal, some not finite."""
    rng = np.random.default_rng(0)
    a, b = (rng.integers(-3, 3, (5000, n)).astype(F64) for n in (columns, 2))
    a[rng.random(5000) < 0.1] *= 1.1
    a[7, 0], b[4003, 1] = np.nan, -np.inf
    values = np.c_[a[:, 1::-1] if columns == 2 else a[:, :2], b[:, ::-1], a[:, 2:]] + 0.0
    spans = np.array([[0, 4990, 32], [4990, 10, 5024], [5000, 0, 0]], I32)
    order, places, counts, boxes = kernels(
        "geometry.matches.sort_matches", a, b, spans,
        out=[((5000,), I32), ((5000,), I32), ((3,), I32), ((3, 2, 2 + columns), F64)],
    )  # fmt: skip
    for pair, (first, number, start) in enumerate(spans):
        mine = values[first : first + number]
        key = np.zeros(number, np.uint64)
        for column in mine.T.copy().view(np.uint64):
            key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
            key ^= key >> np.uint64(29)
        rows = np.flatnonzero(np.isfinite(mine).all(axis=1))
        rows = rows[np.argsort(key[rows] >> np.uint64(18), kind="stable")]
        fresh = np.r_[True, (mine[rows[1:]] != mine[rows[:-1]]).any(axis=1)][: len(rows)]
        assert counts[pair] == fresh.sum()
        assert counts[0] < 4000
        assert order[first : first + fresh.sum()].tolist() == rows[fresh].tolist()
        want = np.full(number, -1)
        want[rows] = start + np.cumsum(fresh) - 1
        assert places[first : first + number].tolist() == want.tolist()
        box = [mine[rows].min(axis=0), mine[rows].max(axis=0)] if number else 0.0
        np.testing.assert_array_equal(boxes[pair], np.broadcast_to(box, (2, 2 + columns)))


def test_refine_ends_on_fundamental_matrices(kernels):
    """The refined matrix has the least robust cost, and a determinant of 0."""
    matches, squares, chosen = views(), np.array([1e-4], F32), np.zeros(1, I32)
    given = Given(matches, np.array([[0, 96]], I32), squares, PLANES)
    start = reference.true_fundamental() + np.random.default_rng(0).normal(0, 1e-3, (3, 3))
    model, scores = kernels(
        "geometry.robust.refine", given, chosen, 3, np.array([9, 4, 4, 4, 4, 4, 4, 4, 4], F32),
        out=[start.reshape(1, 1, 9), ((1, 1, 2), I32)],
    )  # fmt: skip
    f = model[0, 0] / np.linalg.norm(model[0, 0])
    assert abs(np.linalg.det(f.reshape(3, 3))) < 1e-7
    assert (*scores[0, 0],) == reference.cost(model[0, 0], matches, squares[0], 3)

    def total(g):
        u, s, vt = np.linalg.svd(np.reshape(g, (3, 3)))
        gaps = reference.distances((u[:, :2] * s[:2]) @ vt[:2], matches)
        return reference.robust_cost(gaps**2, 4 * squares[0])

    best = scipy.optimize.minimize(total, f, method="BFGS", options={"gtol": 1e-14})
    assert total(f) <= best.fun * (1 + 1e-6)


def views(count=96, wild=12, noise=1e-3):
    """Matches of `reference.true_fundamental`, in the form of kernels."""
    rng = np.random.default_rng(1)
    scene = np.c_[rng.uniform(-1, 1, (count, 2)), rng.uniform(2, 4, count)]
    a = scene[:, :2] / scene[:, 2:]
    moved = scene @ reference.ROTATION.T + reference.TRANSLATION
    b = moved[:, :2] / moved[:, 2:]
    b[:wild] = rng.uniform(-0.5, 0.5, (wild, 2))
    return (np.c_[a, b] + rng.normal(0, noise, (count, 4))).T.astype(F32)


def test_propose_fundamental_matrices(kernels):
    matches, spans = views(), np.array([[0, 96]], I32)
    squares, chosen = np.array([1e-5], F32), np.zeros(1, I32)
    models, costs = kernels(
        "geometry.robust.propose", Given(matches, spans, squares, PLANES), chosen, Draw(3, 2, 64),
        out=[((1, 3, 9), F32), ((1, 3), I32)],
    )  # fmt: skip
    for g in range(3):
        best = reference.best_of_group(3, 2, 64 + 64 * g, matches, squares[0])
        assert best is not None
        preview, _, right = best
        model = models[0, g]
        assert costs[0, g] == reference.cost(model, matches, squares[0], 3)[0]
        assert reference.cost(model, matches[:, :64], squares[0], 3)[0] == pytest.approx(
            preview, abs=96
        )
        one, other = model / np.linalg.norm(model), right / np.linalg.norm(right)
        # Float32 of a solution of seven equations, whose condition may be a thousand.
        assert min(np.abs(one - other).max(), np.abs(one + other).max()) < 1e-3


def test_propose_epipoles_beside_a_plane(kernels):
    """Of a plane's homography and two matches off it; most pairs of exact matches are right."""
    matches = views(wild=0, noise=0)
    plane = reference.ROTATION + np.outer(reference.TRANSLATION, (0.02, 0.01, 0.3))
    spans, squares, chosen = np.array([[0, 96]], I32), np.array([1e-7], F32), np.zeros(1, I32)
    models, costs = kernels(
        "geometry.robust.propose", Given(matches, spans, squares, plane.reshape(1, 9)), chosen,
        Draw(4, 0, 0), out=[((1, 4, 9), F32), ((1, 4), I32)],
    )  # fmt: skip
    right = reference.true_fundamental()
    for model, cost in zip(models[0], costs[0], strict=True):
        one, other = model / np.linalg.norm(model), right.ravel() / np.linalg.norm(right)
        assert min(np.abs(one - other).max(), np.abs(one + other).max()) < 1e-3
        assert cost == reference.cost(model, matches, squares[0], 4)[0]


def test_matches_on_the_plane_have_no_epipole(kernels):
    a = np.random.default_rng(0).uniform(-1, 1, (2, 32)).astype(F32)
    spans, squares = np.array([[0, 32]], I32), np.array([1e-4], F32)
    given = Given(np.concatenate([a, a]), spans, squares, np.eye(3).reshape(1, 9))
    models, costs = kernels(
        "geometry.robust.propose", given, np.zeros(1, I32), Draw(4, 0, 0),
        out=[((1, 2, 9), F32), ((1, 2), I32)],
    )  # fmt: skip
    assert (costs == reference.NO_COST).all()
    assert (models == 0).all()


def test_fundamental_matrices_have_equal_bits(all_kernels):
    matches, spans = views(wild=40), np.array([[0, 96]], I32)
    squares, chosen = np.array([1e-5], F32), np.zeros(1, I32)
    given = Given(matches, spans, squares, reference.ROTATION.reshape(1, 9))
    answers = []
    for kernels in all_kernels:
        answer = []
        for kind in (3, 4):
            models, costs = kernels(
                "geometry.robust.propose", given, chosen, Draw(kind, 2, 64),
                out=[((1, 8, 9), F32), ((1, 8), I32)],
            )  # fmt: skip
            best = kernels("geometry.robust.choose", models, costs, chosen, out=[((1, 4, 9), F64)])
            end = kernels(
                "geometry.robust.refine", given, chosen, 3, np.array([9, 4, 2, 2], F32),
                out=[best, ((1, 4, 2), I32)],
            )  # fmt: skip
            answer += [models, costs, best, *end]
        answers.append(answer)
    assert_as_equal_as_can_be(*answers, on_gpu=all_kernels[0].device != "cpu")
