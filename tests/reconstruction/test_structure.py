"""``reconstruct`` from images: rendered boards, duplicates, strangers, and nothing."""

import numpy as np
import pytest

import cvkern
from cvkern.images import write_image
from tests.reconstruction import scenes

LENS = cvkern.Camera([[190.0, 0, 99.5], [0, 190, 74.5], [0, 0, 1]], shape=(150, 200))


@pytest.fixture(scope="module")
def heap():
    """Return four photographs of boards, a stranger, three of other boards, and the true poses."""
    poses = scenes.ring(4, spread=0.45)
    images = scenes.photographs(poses, LENS)
    noise = np.random.default_rng(1).integers(0, 256, LENS.shape).astype(np.uint8)
    others = scenes.photographs(poses[:3], LENS, seed=7)
    return [*images, noise, *others], poses


def test_cameras_of_photographs(heap):
    images, poses = heap
    found = cvkern.reconstruct(images, LENS, models="all")
    assert found.placed.tolist() == [0, 1, 2, 3]
    assert found.unplaced == ("0004", "0005", "0006", "0007")
    (other,) = found.others
    assert other.placed.tolist() == [5, 6, 7]
    assert scenes.errors(other.poses[5:], poses[:3])[0] < 0.02
    centres, turns = scenes.errors(found.poses[:4], poses)
    # Keypoints to a fifth of a pixel or so, 190 pixels away; a base of 1.8 at a distance of 4.
    assert centres < 0.02
    assert turns < 0.2
    assert len(found.points) > 100
    assert found.errors.max() < 4
    # What the result says of itself is true.
    seen = scenes.project(found.poses[:4], found.points, LENS)
    off = np.linalg.norm(seen[found.tracks[:, 1], found.tracks[:, 0]] - found.places, axis=1)
    mean = np.bincount(found.tracks[:, 0], off) / np.bincount(found.tracks[:, 0])
    np.testing.assert_allclose(found.errors, mean, atol=1e-6)
    key = found.tracks[:, 0].astype(int) * 10 + found.tracks[:, 1]
    assert (np.diff(key) > 0).all()


def test_runs_are_equal(heap):
    images, _ = heap
    one, other = (cvkern.reconstruct(images[:3], LENS) for _ in range(2))
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.points, other.points)


def test_unknown_lens_and_a_folder(heap, tmp_path):
    images, poses = heap
    for name, image in zip("dabc", images[:4], strict=True):
        write_image(tmp_path / f"{name}.png", image)
    (tmp_path / "notes.txt").write_text("no photograph")
    (tmp_path / "broken.png").write_bytes((tmp_path / "a.png").read_bytes()[:500])
    with pytest.warns(UserWarning, match=r"left out: path must be a readable image.*broken\.png"):
        found = cvkern.reconstruct(tmp_path)
    assert found.names == ("a.png", "b.png", "c.png", "d.png")
    assert found.unplaced == ()
    # Four photographs on an arc hardly fix a focal length.
    assert abs(found.lenses[0].matrix[0, 0] / 190 - 1) < 0.1
    centres, _ = scenes.errors(found.poses, poses[[1, 2, 3, 0]])
    assert centres < 0.1


def test_there_may_be_nothing(heap):
    images, _ = heap
    for given in ([images[0], images[0]], [images[0], images[4]], [np.zeros((9, 9))] * 3):
        found = cvkern.reconstruct(given)
        assert len(found.placed) == len(found.points) == 0
        assert len(found.unplaced) == len(given)
