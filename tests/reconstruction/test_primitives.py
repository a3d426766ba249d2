"""Primitives of bundle adjustment against NumPy."""

import numpy as np
import pytest

from cvkern.kernels.codes.reconstruction import (
    JOINED,
    Blocks,
    Condensed,
    Eliminated,
    Loss,
    Scenery,
    Sightings,
    Slopes,
)
from tests.primitives import I32
from tests.reconstruction import reference_adjustment as reference
from tests.reconstruction import scenes

F64 = np.float64


def bundle(behind=False):
    made = scenes.make(count=4, points=7, noise=2.0, bent=(-0.2, 0.1, 0.01, -0.02, 0.05))
    turns = made.poses[:, :, :3].transpose(0, 2, 1)
    shifts = -np.einsum("nij,nj->ni", turns, made.poses[:, :, 3])
    views = np.concatenate((turns.reshape(-1, 9), shifts), axis=1)
    lens = np.concatenate((made.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], made.camera.distortion))
    lenses = np.stack((lens, lens * 1.1))
    points = made.points.copy()
    if behind:
        points[3] = made.poses[0, :, 3] - 3 * made.poses[0, :, 2]
    point, view = made.tracks.T
    ends = np.stack((view, view % 2, point), axis=1).astype(I32)
    counts = np.bincount(point)
    by_view = np.bincount(view)
    sightings = Sightings(
        np.ascontiguousarray(made.places[:, ::-1]), ends,
        np.stack((np.cumsum(counts) - counts, counts), axis=1).astype(I32),
        np.argsort(view, kind="stable").astype(I32),
        np.stack((np.cumsum(by_view) - by_view, by_view), axis=1).astype(I32),
    )  # fmt: skip
    return Scenery(views, lenses, points), sightings


def room(count, size):
    return Slopes(((count, 2, 3 + size), F64), ((count, 2), F64), ((count,), F64))


@pytest.mark.parametrize(
    ("size", "loss", "behind"),
    [
        (6, Loss.SQUARED, False),
        (7, Loss.HUBER, True),
        (9, Loss.CAUCHY, True),
        (11, Loss.HUBER, False),
    ],
)
def test_linearise(kernels, size, loss, behind):
    scenery, sightings = bundle(behind)
    count = len(sightings.ends)
    found = Slopes(*kernels(
        "reconstruction.adjustment.linearise", scenery, sightings, int(loss), 1.5,
        out=[room(count, size)],
    ))  # fmt: skip
    want = reference.gaps(*scenery, sightings.where, sightings.ends)
    # Coordinates of 600 pixels and more, rounded some twenty times.
    np.testing.assert_allclose(found.gaps, want, rtol=1e-14, atol=1e-10)
    there = want[:, 0] < 1e3
    assert there.all() != behind
    length = np.linalg.norm(want, axis=1)
    weights = {
        Loss.SQUARED: np.ones(count),
        Loss.HUBER: np.minimum(1, 1.5 / length),
        Loss.CAUCHY: 1 / (1 + (length / 1.5) ** 2),
    }[loss]
    np.testing.assert_allclose(found.weights, np.where(there, weights, 0), rtol=1e-9)
    slopes = reference.slopes(*scenery, sightings.where, sightings.ends, size)
    # Differences of numbers of 1e3, rounded to 1e-13, over 2e-6; derivatives are below 1e3.
    np.testing.assert_allclose(found.slopes, slopes, rtol=1e-6, atol=2e-6)
    measured = kernels(
        "reconstruction.adjustment.measure", scenery, sightings, out=[((count, 2), F64)]
    )
    np.testing.assert_array_equal(measured, found.gaps)


def step(kernels, scenery, sightings, size, damping):
    """Return the results of the primitives for one step, with made-up steps of views."""
    count, views, points = len(sightings.ends), len(scenery.views), len(scenery.points)
    slopes = Slopes(*kernels(
        "reconstruction.adjustment.linearise", scenery, sightings, int(Loss.CAUCHY), 2.0,
        out=[room(count, size)],
    ))  # fmt: skip
    eliminated = Eliminated(*kernels(
        "reconstruction.adjustment.eliminate", slopes, sightings, damping,
        out=[Eliminated(((points, 6), F64), ((points, 3), F64))],
    ))  # fmt: skip
    blocks = blocks_of(sightings, views)
    condensed = Condensed(*kernels(
        "reconstruction.adjustment.condense", slopes, sightings, eliminated, blocks,
        out=[Condensed(
            ((len(blocks.views), size, size), F64), ((views, size), F64), ((views, size), F64)
        )],
    ))  # fmt: skip
    steps = np.random.default_rng(0).normal(0, 1e-3, (views, size))
    moved = kernels(
        "reconstruction.adjustment.substitute", slopes, sightings, eliminated, steps,
        scenery.points, out=[((points, 3), F64)],
    )  # fmt: skip
    return slopes, eliminated, condensed, steps, moved


def blocks_of(sightings, views):
    """Return the pairs of views that see a point, found pair by pair."""
    seen = [set(sightings.ends[sightings.ends[:, 0] == c, 2].tolist()) for c in range(views)]
    pairs = [(c, d) for c in range(views) for d in range(c, views) if c == d or seen[c] & seen[d]]
    number = np.full((views, views), -1, I32)
    for n, (c, d) in enumerate(pairs):
        number[c, d] = n
    return Blocks(np.array(pairs, I32), number)


@pytest.mark.parametrize("size", [6, 9])
def test_schur_complement(kernels, size):
    scenery, sightings = bundle()
    views, points = len(scenery.views), len(scenery.points)
    slopes, eliminated, condensed, steps, moved = step(kernels, scenery, sightings, size, 0.1)
    square, pull = reference.dense(*slopes, sightings.ends, views, points, 0.1)
    cut = views * size
    b, e, c = square[:cut, :cut], square[:cut, cut:], square[cut:, cut:]
    inverse = np.linalg.inv(c)
    whole = b - e @ inverse @ e.T
    first, second = blocks_of(sightings, views).views.T
    blocks = whole.reshape(views, size, views, size)[first, :, second]
    scale = np.abs(b).max()
    # Conditions of the points' blocks are about 1e3: digits that they lose of 16.
    np.testing.assert_allclose(condensed.system, blocks, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(condensed.sizes.ravel(), np.diag(b), rtol=1e-12)
    want = pull[:cut] - e @ inverse @ pull[cut:]
    np.testing.assert_allclose(condensed.right.ravel(), want, rtol=0, atol=1e-11 * scale)
    back = -inverse @ (pull[cut:] + e.T @ steps.ravel())
    np.testing.assert_allclose((moved - scenery.points).ravel(), back, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(eliminated.pulls.ravel(), inverse @ pull[cut:], rtol=1e-9)


@pytest.mark.parametrize("loss", list(Loss))
def test_join_costs(kernels, loss):
    gaps = np.random.default_rng(0).normal(0, 3, (2 * JOINED + 3, 2))
    joined = kernels(
        "reconstruction.adjustment.join_costs", gaps, int(loss), 1.5, out=[((3,), F64)]
    )
    length = np.linalg.norm(gaps, axis=1)
    cost = {
        Loss.SQUARED: length**2 / 2,
        Loss.HUBER: np.where(length < 1.5, length**2 / 2, 1.5 * (length - 0.75)),
        Loss.CAUCHY: 1.5**2 / 2 * np.log1p((length / 1.5) ** 2),
    }[loss]
    numbers = 1.5**2 * np.log(joined) if loss == Loss.CAUCHY else joined
    sums = np.add.reduceat(cost, [0, JOINED, 2 * JOINED])
    np.testing.assert_allclose(numbers / 2, sums, rtol=1e-13)


def test_the_sets_give_equal_bits(all_kernels):
    scenery, sightings = bundle(behind=True)
    first, *others = [step(k, scenery, sightings, 11, 1e-3) for k in all_kernels]
    # Taichi's division of float64 is not IEEE's on CUDA: digits that a step then loses.
    rounding = 1e-9 if all_kernels[0].device.startswith("cuda") else 0
    for other in others:
        for a, b in zip(first, other, strict=True):
            for one, two in zip(a, b, strict=True):
                scale = rounding * np.abs(one).max()
                np.testing.assert_allclose(two, one, rtol=0, atol=scale)
