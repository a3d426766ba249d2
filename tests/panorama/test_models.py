"""Alignments of cameras that are known: rotations, sheets, rings, and what cannot be adjusted."""

import numpy as np
import pytest
import scipy.special
from scipy.optimize import approx_fprime

from cvkern.panorama import adjustment, models
from cvkern.panorama.adjustment import Planes, Rotations, observe
from cvkern.panorama.models import align, spanning_tree
from cvkern.panorama.registration import Link
from tests.panorama.scenes import angle_between, turned

SIDE = np.array([400, 300])  # width, height
FOCAL = 450.0
MIDDLE = (SIDE - 1) / 2


def link(i, j, matrix, rng, noise=0.3, count=60):
    """Return matches between two images, of points that both see."""
    points = rng.uniform(0, SIDE - 1, (40 * count, 2))
    q = np.c_[points, np.ones(len(points))] @ matrix.T
    there = q[:, :2] / q[:, 2:]
    seen = (q[:, 2] > 0) & (there >= 0).all(axis=1) & (there <= SIDE - 1).all(axis=1)
    a, b = points[seen][:count], there[seen][:count]
    a, b = (p + rng.normal(0, noise, p.shape) for p in (a, b))
    return Link(i, j, matrix / np.cbrt(np.linalg.det(matrix)), a, b, len(a))


def camera(rotation, focal):
    return np.array([[focal, 0, MIDDLE[0]], [0, focal, MIDDLE[1]], [0, 0, 1]]) @ rotation


def links_of(matrices, pairs, rng, **options):
    return [link(i, j, matrices[j] @ np.linalg.inv(matrices[i]), rng, **options) for i, j in pairs]


def aligned(links, count, focals=None):
    return align(links, np.tile(SIDE, (count, 1)), np.ones((count, 2)), focals)


def test_a_ring_closes_to_a_tenth_of_a_degree():
    rng = np.random.default_rng(0)
    count = 15
    tilts = rng.normal(0, 1.5, (2, count))
    rotations = [turned(360 * i / count, *t) for i, t in enumerate(tilts.T)]
    cameras = [camera(r, FOCAL) for r in rotations]
    found = aligned(links_of(cameras, [(i, (i + 1) % count) for i in range(count)], rng), count)
    assert found.model == "rotation"
    assert np.abs(np.asarray(found.focals) / FOCAL - 1).max() < 0.005
    turns = np.asarray(found.rotations)
    off = [
        angle_between(turns[i] @ turns[j].T, rotations[i] @ rotations[j].T)
        for i in range(count)
        for j in range(i)
    ]
    assert max(off) < 0.1


@pytest.mark.parametrize("given", [False, True])
def test_rotations_of_a_few_cameras(given):
    rng = np.random.default_rng(1)
    focals = np.array([430.0, 450.0, 520.0, 450.0])
    rotations = [turned(0), turned(18, 2), turned(15, -14, 88), turned(33, -4)]
    cameras = [camera(r, f) for r, f in zip(rotations, focals, strict=True)]
    pairs = [(0, 1), (1, 2), (1, 3), (2, 3), (0, 2)]
    known = np.array([440.0, np.nan, 500.0, 455.0]) if given else None
    found = aligned(links_of(cameras, pairs, rng), 4, known)
    assert found.model == "rotation"
    assert np.abs(np.asarray(found.focals) / focals - 1).max() < 0.03
    turns = np.asarray(found.rotations)
    off = turns[1] @ turns[3].T @ (rotations[3] @ rotations[1].T)
    assert angle_between(off, np.eye(3)) < 0.2
    assert found.residual < 1


def test_focal_lengths_that_the_matches_contradict_are_not_used():
    rng = np.random.default_rng(7)
    cameras = [camera(turned(16 * i, 3 * (-1) ** i), FOCAL) for i in range(5)]
    links = links_of(cameras, [(i, i + 1) for i in range(4)], rng)
    found = aligned(links, 5, np.full(5, 0.4 * FOCAL))
    assert found.model == "rotation"
    assert np.abs(np.asarray(found.focals) / FOCAL - 1).max() < 0.03


SHEETS = {
    "affine": [
        np.array([[1, 0.02 * i, -150.0 * i], [-0.03 * i, 1, 60 * i], [0, 0, 1]]) for i in range(4)
    ],
    "homography": [
        np.array([[1, 0.02 * i, -130.0 * i], [-0.03 * i, 1, 50 * i], [2e-4 * i, -3e-4 * i, 1]])
        for i in range(3)
    ],
}


@pytest.mark.parametrize("model", SHEETS)
def test_sheets(model):
    rng = np.random.default_rng(2)
    matrices = SHEETS[model]
    count = len(matrices)
    pairs = [(i, j) for i in range(count) for j in range(i + 1, min(count, i + 3))]
    links = links_of(matrices, pairs, rng)
    found = aligned(links, count)
    # Moved cameras before a sheet are no rotations, and a shift of scans has no focal length.
    assert found.model == model
    assert found.focals is None
    middle = np.array([[1, 0, MIDDLE[0]], [0, 1, MIDDLE[1]], [0, 0, 1]])
    for link in links:
        across = (
            middle
            @ found.matrices[link.second]
            @ np.linalg.inv(middle @ found.matrices[link.first])
        )
        points = np.c_[link.points0, np.ones(len(link.points0))]
        got, want = (points @ m.T for m in (across, link.matrix))
        assert np.abs(got[:, :2] / got[:, 2:] - want[:, :2] / want[:, 2:]).max() < 1


def test_a_sheet_lies_in_the_plane_of_an_image_that_sees_all_before_the_horizon():
    """In that of the central image, the last one reaches beyond it."""
    rng = np.random.default_rng(8)
    shift = np.array([[1, 0, -MIDDLE[0]], [0, 1, -MIDDLE[1]], [0, 0, 1]])
    tilts = [np.array([[1, 2 * p, 0], [0, 1 + 99 * p, 0], [p, 0, 1]]) for p in (0, 2e-3, 5.2e-3)]
    matrices = [np.linalg.inv(shift) @ tilt @ shift for tilt in tilts]
    links = [
        *links_of(matrices, [(0, 1), (0, 2)], rng, count=90), *links_of(matrices, [(1, 2)], rng)
    ]  # fmt: skip
    found = aligned(links, 3)
    assert found.model == "homography"
    assert found.parents.tolist() == [-1, 0, 0]
    np.testing.assert_allclose(found.matrices[1] / found.matrices[1][2, 2], np.eye(3), atol=1e-9)
    for tilt, matrix in zip(tilts, found.matrices, strict=True):
        want = tilt @ np.linalg.inv(tilts[1])
        # A corner 250 pixels from the middle is off by less than a pixel.
        off = matrix / matrix[2, 2] - want
        assert np.abs(off @ np.diag([250, 250, 1]))[:2].max() < 1


def test_a_wrong_pair_is_left_out():
    rng = np.random.default_rng(3)
    cameras = [camera(turned(14 * i), FOCAL) for i in range(5)]
    links = links_of(cameras, [(i, j) for i in range(5) for j in range(max(0, i - 2), i)], rng)
    shift = np.array([[1, 0, 120.0], [0, 1, 40], [0, 0, 1]])
    links.append(link(0, 4, shift, rng, count=25))
    found = aligned(links, 5)
    assert found.model == "rotation"
    assert np.abs(np.asarray(found.focals) / FOCAL - 1).max() < 0.02


def test_a_square_that_does_not_close_loses_a_side():
    rng = np.random.default_rng(4)
    steps = [(150.0, 0.0), (0, 120), (130, 10), (20, 110)]
    shifts = [np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1]]) for x, y in steps]
    links = [link(i, (i + 1) % 4, s, rng) for i, s in enumerate(shifts)]
    found = aligned(links, 4)
    assert found.model == "affine"
    assert found.residual < 1


@pytest.mark.parametrize(("model", "tilt"), [("homography tree", 2e-4), ("similarity tree", 5e-3)])
def test_what_cannot_be_adjusted_hangs_on_its_best_pairs(model, tilt, monkeypatch):
    rng = np.random.default_rng(4)
    monkeypatch.setattr(models, "WORST", 0.01)
    monkeypatch.setattr(models, "SMALL", 0.01)
    step = np.array([[1, 0, -130.0], [0.02, 1, 30], [tilt, 0, 1 - tilt * MIDDLE[0]]])
    links = [link(i, i + 1, step, rng, count=90 - i) for i in range(3)]
    found = aligned(links, 4)
    assert found.model == model
    assert found.parents.tolist() == [1, -1, 1, 2]
    across = found.matrices[2] @ np.linalg.inv(found.matrices[1])
    middle = np.array([[1, 0, MIDDLE[0]], [0, 1, MIDDLE[1]], [0, 0, 1]])
    across = middle @ across @ np.linalg.inv(middle)
    if model == "homography tree":
        step = step / step[2, 2]
        np.testing.assert_allclose(across / across[2, 2], step, rtol=1e-6, atol=1e-9)
    else:
        assert abs(across[2, :2]).max() < 1e-9  # nothing comes to lie behind an image


def test_the_tree_has_most_inliers():
    rng = np.random.default_rng(5)
    sizes = {(0, 1): 50, (1, 2): 40, (0, 2): 30, (2, 3): 10, (0, 3): 20}
    links = [link(i, j, np.eye(3), rng, count=n) for (i, j), n in sizes.items()]
    parents, order = spanning_tree(4, links)
    assert parents.tolist() == [-1, 0, 1, 0]
    assert order == [0, 1, 2, 3]


@pytest.mark.parametrize("kind", ["rotations", "bent rotations", 4, 6, 8])
def test_slopes(kind):
    """The normal equations are those of numerical derivatives."""
    rng = np.random.default_rng(6)
    cameras = [camera(turned(10 * i, i), FOCAL) for i in range(3)]
    links = links_of(cameras, [(0, 1), (1, 2), (0, 2)], rng, noise=2.0, count=8)
    seen = observe(links, np.tile(MIDDLE, (3, 1)), 400.0, np.ones((3, 2)))
    if kind in ("rotations", "bent rotations"):
        model = Rotations(np.stack([turned(9 * i, i) for i in range(3)]), np.array([1.1, 1.2, 1.0]))
        model.bend, model.bends = (0.15, True) if kind == "bent rotations" else (0.0, False)
    else:
        made = np.stack([np.eye(3)] * 3)
        made[:, :2, 2] = [(0, 0), (-0.2, 0.02), (-0.4, 0.01)]
        model = Planes(made, kind)
    steps = np.zeros(3 * model.size + 1)

    def residuals(x):
        return adjustment.residuals(seen, model.moved(x)).ravel()

    slopes = np.asarray(approx_fprime(steps, residuals, 1e-7))
    normal, gradient = adjustment._normal(seen, model, 1e9)
    extra, curvature = model.prior()[1:]
    if not model.bends:  # the last number is the lens
        slopes[:, -1] = 0
    want = slopes.T @ slopes + np.diag(curvature)
    # Differences of float64 over 1e-7 have about 1e-6 of error.
    np.testing.assert_allclose(normal, want, rtol=1e-4, atol=1e-4 * np.abs(want).max())
    pull = slopes.T @ residuals(steps) + extra
    np.testing.assert_allclose(gradient, pull, rtol=1e-4, atol=1e-4 * np.abs(pull).max())
    # Half of the residuals are beyond the limit, from which on the cost is linear.
    lengths = np.linalg.norm(adjustment.residuals(seen, model), axis=-1)
    limit = float(np.median(lengths[lengths > 0]))
    want = scipy.special.huber(limit, lengths).sum() + model.prior()[0]
    assert adjustment.cost(seen, model, limit) == pytest.approx(want, rel=1e-12)
    pull = np.asarray(
        approx_fprime(steps, lambda x: adjustment.cost(seen, model.moved(x), limit), 1e-7)
    )
    if not model.bends:
        pull[-1] = 0
    gradient = adjustment._normal(seen, model, limit)[1]
    np.testing.assert_allclose(gradient, pull, rtol=1e-3, atol=1e-3 * np.abs(pull).max())
