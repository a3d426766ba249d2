"""Robust fits with known cameras, as primitives: essential matrices and poses."""

import numpy as np
import pytest
import scipy.optimize

from cvkern.kernels.codes.geometry import Draw, Given
from tests.geometry import reference_robust as reference
from tests.geometry.test_robust import assert_as_equal_as_can_be

F32, F64, I32, U8 = np.float32, np.float64, np.int32, np.uint8
ESSENTIAL, POSE = 5, 6
CHOSEN = np.zeros(1, I32)
K0 = np.array([[0.9, 0.02, 0.1], [0, 0.8, -0.05], [0, 0, 1]])
K1 = np.array([[1.1, 0, -0.1], [0, 1.2, 0.1], [0, 0, 1]])
COUNT, WILD = 96, 24


def given(kind, noise=1e-3, threshold=0.01):
    """Matches with outliers, in the form of kernels, and the two cameras."""
    rng = np.random.default_rng(1)
    scene = np.c_[rng.uniform(-1, 1, (COUNT, 2)), rng.uniform(2, 4, COUNT)]
    moved = scene @ reference.ROTATION.T + reference.TRANSLATION
    a, b = (q[:, :2] / q[:, 2:] for q in (scene @ K0.T, moved @ K1.T))
    b[:WILD] = rng.uniform(-0.5, 0.5, (WILD, 2))
    first = scene[:, :2] if kind == POSE else a + rng.normal(0, noise, a.shape)
    rows = [first, b + rng.normal(0, noise, b.shape)]
    rows += [scene[:, 2:]] if kind == POSE else []
    known = [K1, np.linalg.inv(K1)]
    if kind == ESSENTIAL:
        known = [np.linalg.inv(K0), np.linalg.inv(K1), K0, K1]
    return Given(
        np.concatenate(rows, 1).T.astype(F32),
        np.array([[0, COUNT]], I32),
        np.array([threshold**2], F32),
        np.concatenate(known).reshape(1, -1),
    )


def projection(model):
    """Return K (R | t) of two rows of R, and t."""
    first, second, shift = np.reshape(model, (3, 3)).astype(F64)
    return K1 @ np.c_[np.stack((first, second, np.cross(first, second))), shift]


def residuals(kind, model, matches):
    """Return squared residuals in float32, in the order in which kernels compute them."""
    if kind == ESSENTIAL:
        return reference.residuals(model, matches, 3)
    p = projection(model).astype(F32).ravel()
    x, y, u, v, z = matches
    rows = [((p[i] * x + p[i + 1] * y) + p[i + 2] * z) + p[i + 3] for i in (0, 4, 8)]
    w = F32(1) / rows[2]
    return np.where(rows[2] > 0, (rows[0] * w - u) ** 2 + (rows[1] * w - v) ** 2, F32(1e30))


def score(kind, model, g):
    r = residuals(kind, model, g.matches)
    near = r < g.squares[0]
    units = (r[near] * (F32(reference.COST_ONE) / g.squares[0]) + F32(0.5)).astype(int)
    return units.sum() + reference.COST_ONE * np.sum(~near), near.sum()


def essential_of(model):
    """Return the matrix for rays of one for points."""
    return K1.T @ np.reshape(model, (3, 3)).astype(F64) @ K0


@pytest.mark.parametrize("kind", [ESSENTIAL, POSE])
def test_propose_solves_samples(kernels, kind):
    """Exact matches: the best of each group is the truth, and costs nothing."""
    g = given(kind, 0.0, 1e-4)
    models, costs = kernels(
        "geometry.robust.propose", g, CHOSEN, Draw(kind, 3, 64),
        out=[((1, 4, 9), F32), ((1, 4), I32)],
    )  # fmt: skip
    for model, cost in zip(models[0], costs[0], strict=True):
        assert cost == score(kind, model, g)[0]
        assert cost <= reference.COST_ONE * (WILD + 1)
        # Float32 keeps 24 bits of matches, which samples may magnify a thousand times.
        if kind == ESSENTIAL:
            e = essential_of(model)
            e /= np.linalg.norm(e)
            x, y, z = reference.TRANSLATION
            right = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ reference.ROTATION
            right /= np.linalg.norm(right)
            assert min(np.abs(e - right).max(), np.abs(e + right).max()) < 1e-3
        else:
            right = K1 @ np.c_[reference.ROTATION, reference.TRANSLATION]
            assert np.abs(projection(model) - right).max() < 1e-3


def test_every_solution_is_an_essential_matrix(kernels):
    """With five matches all solutions fit; the first one is proposed, whichever it is."""
    found = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        matches = np.zeros((4, 32), F32)
        matches[:, :5] = rng.uniform(-1, 1, (4, 5))
        g = given(ESSENTIAL)._replace(matches=matches, spans=np.array([[0, 5]], I32))
        models, costs = kernels(
            "geometry.robust.propose", g, CHOSEN, Draw(ESSENTIAL, seed, 0),
            out=[((1, 1, 9), F32), ((1, 1), I32)],
        )  # fmt: skip
        if costs[0, 0] < reference.NO_COST:
            found += 1
            s = np.linalg.svd(essential_of(models[0, 0]))[1]
            np.testing.assert_allclose(s / s[0], (1, 1, 0), atol=1e-4)
            assert np.abs(residuals(ESSENTIAL, models[0, 0], matches[:, :5])).max() < 1e-8
    assert found >= 3  # some five points in general position have no real solution


@pytest.mark.parametrize("kind", [ESSENTIAL, POSE])
def test_refine_has_the_least_robust_cost(kernels, kind):
    g, turn = given(kind), reference.ROTATION
    x, y, z = reference.TRANSLATION + np.array((0.003, -0.002, 0.002))
    start = np.r_[turn[:2].ravel(), x, y, z]
    if kind == ESSENTIAL:
        e = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
        start = (np.linalg.inv(K1).T @ e @ np.linalg.inv(K0)).ravel()
    model, scores = kernels(
        "geometry.robust.refine", g, CHOSEN, kind, np.array([9] + [4] * 9, F32),
        out=[start.reshape(1, 1, 9).copy(), ((1, 1, 2), I32)],
    )  # fmt: skip
    assert (*scores[0, 0],) == score(kind, model[0, 0], g)
    assert scores[0, 0, 1] > 60
    limit = 4 * float(g.squares[0])
    wide = g.matches.astype(F64)

    def cost(free):
        """Six numbers: a turn of the start, by Cayley's formula, and the shift."""
        cross = np.cross(np.eye(3), free[:3])
        rotation = np.linalg.solve(np.eye(3) - cross, np.eye(3) + cross) @ turn
        x, y, z = free[3:]
        if kind == ESSENTIAL:
            e = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
            squares = reference.distances(np.linalg.inv(K1).T @ e @ np.linalg.inv(K0), wide) ** 2
        else:
            q = (wide[[0, 1, 4]].T @ rotation.T + free[3:]) @ K1.T
            squares = ((q[:, :2] / q[:, 2:] - wide[2:4].T) ** 2).sum(1)
        return reference.robust_cost(squares, limit)

    best = scipy.optimize.minimize(cost, np.r_[0, 0, 0, reference.TRANSLATION], method="BFGS")
    if kind == ESSENTIAL:
        squares = reference.distances(model[0, 0].reshape(3, 3), wide) ** 2
        s = np.linalg.svd(essential_of(model[0, 0]))[1]
        np.testing.assert_allclose(s / s[0], (1, 1, 0), atol=1e-12)
    else:
        q = np.c_[wide[[0, 1, 4]].T, np.ones(COUNT)] @ projection(model[0, 0]).T
        squares = ((q[:, :2] / q[:, 2:] - wide[2:4].T) ** 2).sum(1)
        rows = model[0, 0, :6].reshape(2, 3)
        np.testing.assert_allclose(rows @ rows.T, np.eye(2), atol=1e-14)
    assert reference.robust_cost(squares, limit) <= best.fun * (1 + 1e-6)


@pytest.mark.parametrize("kind", [ESSENTIAL, POSE])
def test_degenerate_samples_have_no_model(kernels, kind):
    g = given(kind)
    for wrong in (np.zeros_like(g.matches), np.full_like(g.matches, np.nan)):
        models, costs = kernels(
            "geometry.robust.propose", g._replace(matches=wrong), CHOSEN, Draw(kind, 0, 0),
            out=[((1, 2, 9), F32), ((1, 2), I32)],
        )  # fmt: skip
        assert (costs == reference.NO_COST).all()
        assert (models == 0).all()


@pytest.mark.parametrize("kind", [ESSENTIAL, POSE])
def test_equal_bits(all_kernels, kind):
    g, answers = given(kind), []
    for kernels in all_kernels:
        models, costs = kernels(
            "geometry.robust.propose", g, CHOSEN, Draw(kind, 2, 64),
            out=[((1, 4, 9), F32), ((1, 4), I32)],
        )  # fmt: skip
        best = kernels("geometry.robust.choose", models, costs, CHOSEN, out=[((1, 4, 9), F64)])
        end = kernels(
            "geometry.robust.refine", g, CHOSEN, kind, np.array([9, 4, 2, 2], F32),
            out=[best, ((1, 4, 2), I32)],
        )  # fmt: skip
        marks = kernels("geometry.robust.mark", g, kind, end[0][0, :1], out=[((COUNT,), U8)])
        near = residuals(kind, end[0][0, 0], g.matches) < g.squares[0]
        np.testing.assert_array_equal(marks, near)
        answers.append((models, costs, best, *end))
    assert_as_equal_as_can_be(*answers, on_gpu=all_kernels[0].device != "cpu")
