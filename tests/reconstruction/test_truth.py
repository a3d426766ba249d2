"""Photographs with known cameras: rotations, centres, and that every photograph has a place."""

import json

import numpy as np
import pytest

import cvkern
from cvkern.images import read_image
from cvkern.radiance import load_scene, make_scene
from tests.reconstruction import scenes
from tests.truth import truth


def worst(found, poses):
    """Return the errors of what is placed, after the similarity; the extent is twice the radius."""
    placed = found.placed
    centres, turns = scenes.errors(found.poses[placed], poses[placed])
    return centres / 2, turns


def posed(turns, shifts):
    back = turns.transpose(0, 2, 1)
    eyes = -np.einsum("nij,nj->ni", back, shifts)
    return np.concatenate((back, eyes[:, :, None]), axis=2)


@pytest.fixture(scope="module")
def fountain():
    folder = truth("two_view/strecha_fountain_P11")
    told = json.loads((folder / "cameras.json").read_text())
    names = sorted(name for name in told if name.endswith(".jpg"))
    turns = np.array([told[n]["R_world_to_cam"] for n in names])
    images = [read_image(folder / name) for name in names]
    matrix = np.array(told[names[0]]["K"])
    return images, posed(turns, np.array([told[n]["t"] for n in names])), matrix


def test_fountain_with_its_lens(fountain):
    images, poses, matrix = fountain
    found = cvkern.reconstruct(images, cvkern.Camera(matrix, shape=images[0].shape[:2]))
    centres, turns = worst(found, poses)
    assert len(found.placed) == 11
    assert centres < 0.001
    assert turns < 0.05


def test_fountain_at_half_its_size_with_an_unknown_lens(fountain):
    images, poses, matrix = fountain
    small = [cvkern.resize(i, (256, 384), channel_axis=-1, dtype=np.uint8) for i in images[::2]]
    found = cvkern.reconstruct(small)
    centres, _ = worst(found, poses[::2])
    assert len(found.placed) == 6
    assert centres < 0.005
    assert abs(found.lenses[0].matrix[0, 0] / (matrix[0, 0] / 2) - 1) < 0.02


def test_temple():
    folder = truth("multi_view/templeSparseRing")
    rows = [line.split() for line in (folder / "templeSR_par.txt").read_text().splitlines()[1:]]
    rows = [row for row in rows if row]
    numbers = np.array([[float(v) for v in row[1:]] for row in rows])
    images = [read_image(folder / row[0]) for row in rows]
    lens = cvkern.Camera(numbers[0, :9].reshape(3, 3), shape=images[0].shape[:2])
    found = cvkern.reconstruct(images, lens)
    poses = posed(numbers[:, 9:18].reshape(-1, 3, 3), numbers[:, 18:])
    _, turns = worst(found, poses)
    assert len(found.placed) >= 14
    assert turns < 0.5
    # Without the lens, whose principal point is 19 pixels from the middle.
    found = cvkern.reconstruct(images)
    _, turns = worst(found, poses)
    assert len(found.placed) >= 14
    assert turns < 0.6


@pytest.mark.parametrize(("pairs", "neighbors"), [("auto", 16), ("vocabulary", 10)])
def test_fox(pairs, neighbors):
    scene = load_scene(truth("nerf/fox"))
    found = cvkern.reconstruct(scene.images, pairs=pairs, neighbors=neighbors)
    centres, turns = worst(found, scene.cameras.poses)
    assert len(found.placed) == 50
    # The given cameras are another program's: nobody knows which are nearer to the truth.
    assert centres < 0.005
    assert turns < 0.5
    assert abs(found.lenses[0].matrix[0, 0] / scene.cameras.intrinsics[0, 0] - 1) < 0.01


def test_solids():
    truth("nerf")
    scene = make_scene(train=60, test=0, size=400, texture=True)
    found = cvkern.reconstruct(scene.images)
    centres, _ = worst(found, scene.cameras.poses)
    assert len(found.placed) == 60
    assert centres < 0.002
