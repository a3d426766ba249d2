"""``adjust_bundle`` against SciPy's least squares, and on scenes with exact truth."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import cvkern
from cvkern.reconstruction._solving import solve
from tests.reconstruction import scenes


def shaken(scene, size=0.01, seed=1):
    """Return poses, but for the first, and points that are off."""
    rng = np.random.default_rng(seed)
    poses = scene.poses.copy()
    turns = Rotation.from_rotvec(rng.normal(0, size, (len(poses), 3))).as_matrix()
    poses[1:, :, :3] = (turns @ poses[:, :, :3])[1:]
    poses[1:, :, 3] += rng.normal(0, size, (len(poses) - 1, 3))
    return poses, scene.points + rng.normal(0, 3 * size, scene.points.shape)


@pytest.mark.parametrize("loss", ["squared", "huber", "cauchy"])
def test_scipy_finds_nothing_better(backend, loss):
    scene = scenes.make(count=3, points=9, noise=1.0, outliers=0.1)
    poses, points = shaken(scene)
    found = cvkern.adjust_bundle(
        poses, scene.camera, points, scene.tracks, scene.places, loss=loss, scale=1.5,
        max_steps=200,
    )  # fmt: skip

    def off(numbers):
        turns = Rotation.from_rotvec(numbers[:9].reshape(3, 3)).as_matrix()
        eyes, cloud = numbers[9:18].reshape(3, 3), numbers[18:].reshape(-1, 3)
        inside = np.einsum("oji,oj->oi", turns[view], cloud[point] - eyes[view])
        seen = inside[:, 1::-1] / inside[:, 2:] * scenes.FOCAL + scene.camera.matrix[1::-1, 2]
        return np.linalg.norm(seen - scene.places, axis=1)

    point, view = scene.tracks.T
    start = np.concatenate(
        (Rotation.from_matrix(found.poses[:, :, :3]).as_rotvec().ravel(),
         found.poses[:, :, 3].ravel(), found.points.ravel())
    )  # fmt: skip
    first = np.concatenate(
        (Rotation.from_matrix(poses[:, :, :3]).as_rotvec().ravel(), poses[:, :, 3].ravel(),
         points.ravel())
    )  # fmt: skip
    # SciPy's loss has lengths as residuals: the same cost.
    kind: Any = "linear" if loss == "squared" else loss
    best = least_squares(off, start, loss=kind, f_scale=1.5, max_nfev=12)
    np.testing.assert_allclose(off(start), found.errors, rtol=0, atol=1e-9)
    squares = (found.errors / 1.5) ** 2
    rho = {
        "squared": squares,
        "huber": np.where(squares <= 1, squares, 2 * np.sqrt(squares) - 1),
        "cauchy": np.log1p(squares),
    }[loss]
    # Steps end when the cost falls by less than 1e-7 of itself; robust ones get closer slowly.
    assert 1.5**2 * rho.sum() / 2 <= best.cost * (1 + 1e-4)
    assert found.errors.mean() < 0.8 * off(first).mean()
    # Poses pass through their inverse: some rounding.
    np.testing.assert_allclose(found.poses[0], poses[0], atol=1e-12)


@pytest.mark.parametrize(("noise", "outliers", "limit"), [(0, 0, 1e-6), (0.5, 0.1, 0.01)])
def test_scenes_are_found_again(noise, outliers, limit):
    """Without noise to the last digits of the steps; with it, to a share of noise over focal."""
    scene = scenes.make(count=6, points=100, noise=noise, outliers=outliers, bent=(-0.1, 0.02))
    poses, points = shaken(scene)
    lens = scenes.camera(focal=1.05 * scenes.FOCAL)
    found = cvkern.adjust_bundle(
        poses, lens, points, scene.tracks, scene.places, refine="distortion", loss="cauchy",
        max_steps=200,
    )  # fmt: skip
    centres, _ = scenes.errors(found.poses, scene.poses)
    assert centres < limit
    assert abs(found.lenses[0].matrix[0, 0] / scenes.FOCAL - 1) < max(limit, 1e-5)
    assert abs(found.lenses[0].distortion[0] + 0.1) < max(5 * limit, 1e-4)


def test_what_is_fixed_stays():
    scene = scenes.make(count=4, points=40, noise=0.5)
    poses, points = shaken(scene)
    fixed = np.array([True, False, True, False])
    lenses = [scene.camera, scenes.camera(610.0), scenes.camera(700.0)]  # the last: no photograph
    found = cvkern.adjust_bundle(
        poses, lenses, points, scene.tracks, scene.places, lens_of=[0, 1, 0, 1], fixed=fixed,
        refine="all",
    )  # fmt: skip
    # Poses pass through their inverse: some rounding.
    np.testing.assert_allclose(found.poses[fixed], poses[fixed], atol=1e-12)
    assert (np.abs(found.poses[~fixed] - poses[~fixed]).max(axis=(1, 2)) > 1e-4).all()
    np.testing.assert_array_equal(found.lenses[0].matrix, lenses[0].matrix)
    assert found.lenses[1].matrix[0, 0] != 610.0
    np.testing.assert_array_equal(found.lenses[2].matrix, lenses[2].matrix)
    still = cvkern.adjust_bundle(
        poses, lenses, points, scene.tracks, scene.places, lens_of=[0, 1, 0, 1], max_steps=0
    )
    np.testing.assert_array_equal(still.points, points)


def test_order_of_sightings_does_not_matter_and_runs_are_equal():
    scene = scenes.make(count=4, points=40, noise=0.5)
    order = np.random.default_rng(3).permutation(len(scene.tracks))
    found = cvkern.adjust_bundle(
        scene.poses, scene.camera, scene.points, scene.tracks, scene.places
    )
    again = cvkern.adjust_bundle(
        scene.poses, scene.camera, scene.points, scene.tracks[order], scene.places[order]
    )
    np.testing.assert_array_equal(found.poses, again.poses)
    np.testing.assert_array_equal(found.errors[order], again.errors)
    with cvkern.use(backend="taichi"):
        other = cvkern.adjust_bundle(
            scene.poses, scene.camera, scene.points, scene.tracks, scene.places
        )
    np.testing.assert_array_equal(found.points, other.points)


@pytest.mark.parametrize("count", [1, 64, 65, 200])
def test_solve(count):
    rng = np.random.default_rng(count)
    root = rng.normal(size=(count, count))
    matrix, right = root @ root.T + np.eye(count), rng.normal(size=count)
    found = solve(np.tril(matrix), right)
    # The condition is about 4 `count`, of 16 digits.
    np.testing.assert_allclose(matrix @ found, right, rtol=0, atol=1e-11)
    matrix[count // 2, count // 2] = -1
    assert solve(matrix, right) is None
