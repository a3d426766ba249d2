"""Files of reconstructions: round trips, other readers, and broken files."""

import dataclasses
import json
import struct

import numpy as np
import pytest

import cvkern
from cvkern.images import write_image
from cvkern.radiance import load_scene
from tests.reconstruction import scenes


@pytest.fixture(scope="module")
def made():
    """Return three photographs with two lenses; the one in the middle has no place."""
    scene = scenes.make(count=3, points=9, noise=0.5)
    lens = scenes.camera(bent=(-0.1, 0.02, 0.001, -0.002))
    poses = scene.poses.copy()
    poses[1] = np.nan
    kept = scene.tracks[:, 1] != 1
    rng = np.random.default_rng(0)
    return cvkern.Reconstruction(
        ("a b.png", "lost.png", "c.png"), poses, (lens, scenes.camera(700)), np.array([0, 0, 1]),
        scene.points, rng.integers(0, 256, (9, 3)).astype(np.uint8),
        scene.tracks[kept].astype(np.int32), scene.places[kept], rng.random(9),
    )  # fmt: skip


@pytest.mark.parametrize("format", ["colmap", "colmap_binary"])
def test_round_trip(made, tmp_path, format):
    files = cvkern.write_reconstruction(tmp_path, made, format=format)
    assert len(files) == 3
    assert all(file.is_file() for file in files)
    found = cvkern.read_reconstruction(tmp_path)
    assert found.names == ("a b.png", "c.png")
    # Rotations pass through quaternions, principal points and places through a shift by a half.
    np.testing.assert_allclose(found.poses, made.poses[made.placed], atol=1e-14)
    np.testing.assert_array_equal(found.points, made.points)
    np.testing.assert_array_equal(found.colors, made.colors)
    np.testing.assert_array_equal(found.errors, made.errors)
    np.testing.assert_array_equal(found.tracks[:, 0], made.tracks[:, 0])
    np.testing.assert_array_equal(made.placed[found.tracks[:, 1]], made.tracks[:, 1])
    np.testing.assert_allclose(found.places, made.places, atol=1e-12)
    for one, other in zip(found.lenses, made.lenses, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-12)
        np.testing.assert_array_equal(one.distortion, other.distortion)
        assert one.shape == other.shape


@pytest.mark.parametrize("format", ["colmap", "colmap_binary", "transforms"])
def test_load_scene_reads_it(made, tmp_path, format):
    folder = tmp_path / "images"
    folder.mkdir()
    for name in made.names:
        write_image(folder / name, np.zeros((*scenes.SIDES, 3), np.uint8))
    cvkern.write_reconstruction(tmp_path, made, format=format)
    scene = load_scene(tmp_path)
    np.testing.assert_allclose(scene.cameras.poses, made.cameras.poses, atol=1e-6)
    np.testing.assert_allclose(scene.cameras.intrinsics, made.cameras.intrinsics, atol=1e-9)
    np.testing.assert_allclose(scene.cameras.distortion, made.cameras.distortion, atol=1e-12)


def test_what_transforms_say(made, tmp_path):
    (file,) = cvkern.write_reconstruction(tmp_path, made, format="transforms", images="")
    told = json.loads(file.read_text())
    assert [frame["file_path"] for frame in told["frames"]] == ["a b.png", "c.png"]
    assert told["frames"][1]["fl_x"] == 700
    # The middle of an image of 640 columns, from the corner.
    assert told["frames"][0]["cx"] == 320
    # OpenGL's camera looks along its own -z.
    pose = np.array(told["frames"][0]["transform_matrix"])
    np.testing.assert_allclose(-pose[:3, 2], made.poses[0, :, 2])


def test_points(made, tmp_path):
    (file,) = cvkern.write_reconstruction(tmp_path, made, format="ply")
    head, _, rows = file.read_bytes().partition(b"end_header\n")
    assert b"element vertex 9\n" in head
    kind = np.dtype([("at", "<f4", 3), ("color", "u1", 3)])
    cloud = np.frombuffer(rows, kind)
    np.testing.assert_array_equal(cloud["at"], made.points.astype(np.float32))
    np.testing.assert_array_equal(cloud["color"], made.colors)


def test_scenes_and_pictures(made):
    images = [np.full((*scenes.SIDES, 3), i, np.uint8) for i in range(3)]
    scene = made.scene(images, test_every=2)
    assert scene.images[:, 0, 0, 0].tolist() == [0, 2]
    assert scene.test.tolist() == [True, False]
    assert made.unplaced == ("lost.png",)
    drawn = made.picture(80)
    assert drawn.shape == (80, 80, 3)
    # A few points, and two pyramids of eight lines.
    assert 0.01 < (drawn < 255).any(axis=2).mean() < 0.4
    with pytest.raises(ValueError, match="images must be 3, got 2"):
        made.scene(images[:2])
    with pytest.raises(ValueError, match=r"side must be in \[16, 8192\], got 5"):
        made.picture(5)


def test_nothing_is_written_of_nothing(made, tmp_path):
    nothing = cvkern.Reconstruction(
        made.names, np.full((3, 3, 4), np.nan), made.lenses, made.lens_of, made.points[:0],
        made.colors[:0], made.tracks[:0], made.places[:0], made.errors[:0],
    )  # fmt: skip
    assert len(nothing.unplaced) == 3
    assert (nothing.picture(20) == 255).all()
    with pytest.raises(ValueError, match="must have a placed photograph, got none"):
        cvkern.write_reconstruction(tmp_path, nothing)
    with pytest.raises(ValueError, match="must have a placed photograph, got none"):
        _ = nothing.cameras
    with pytest.raises(FileNotFoundError, match="path must be a folder that exists"):
        cvkern.write_reconstruction(tmp_path / "no", made)
    with pytest.raises(ValueError, match="format must be one of"):
        cvkern.write_reconstruction(tmp_path, made, format="xml")
    with pytest.raises(TypeError, match="reconstruction must be a Reconstruction, got int"):
        cvkern.write_reconstruction(tmp_path, 3)  # pyright: ignore[reportArgumentType]
    bent = cvkern.Reconstruction(
        made.names, made.poses, (scenes.camera(bent=(0, 0, 0, 0, 0.1)),), made.lens_of * 0,
        made.points, made.colors, made.tracks, made.places, made.errors,
    )  # fmt: skip
    with pytest.raises(ValueError, match="lenses with k3 = 0"):
        cvkern.write_reconstruction(tmp_path, bent)
    for error, said, field, value in (
        (TypeError, "colors must be real numbers", "colors", [["x"] * 3] * len(made.points)),
        (ValueError, "colors must have shape", "colors", made.colors[1:]),
        (ValueError, "colors must be at least 0 and below 256", "colors", made.colors + 256.0),
        (ValueError, "points must be finite", "points", made.points * np.nan),
        (ValueError, "tracks must be at least 0 and below", "tracks", made.tracks + 3),
    ):
        with pytest.raises(error, match=f"reconstruction.{said}"):
            cvkern.write_reconstruction(tmp_path, dataclasses.replace(made, **{field: value}))
    assert list(tmp_path.iterdir()) == []


def test_broken_files(made, tmp_path):
    with pytest.raises(FileNotFoundError, match="path must hold a COLMAP model"):
        cvkern.read_reconstruction(tmp_path)
    for format, ending in (("colmap_binary", "bin"), ("colmap", "txt")):
        for file in cvkern.write_reconstruction(tmp_path, made, format=format):
            whole = file.read_bytes()
            if ending == "bin":
                file.write_bytes(whole[:-5])
                with pytest.raises(ValueError, match="must be a whole COLMAP model"):
                    cvkern.read_reconstruction(tmp_path)
            else:
                file.write_bytes(whole.replace(b"0", b"x"))
                with pytest.raises(ValueError, match="must"):
                    cvkern.read_reconstruction(tmp_path)
            file.unlink()
            if file.name.startswith("points"):
                with pytest.raises(FileNotFoundError, match="path must hold points3D"):
                    cvkern.read_reconstruction(tmp_path)
            file.write_bytes(whole)
        for file in tmp_path.iterdir():
            file.unlink()
    cvkern.write_reconstruction(tmp_path, made, format="colmap_binary")
    # A point that no file has.
    file = tmp_path / "points3D.bin"
    data = bytearray(file.read_bytes())
    data[8:16] = struct.pack("<Q", 99)
    file.write_bytes(bytes(data))
    with pytest.raises(ValueError, match="must be a whole COLMAP model"):
        cvkern.read_reconstruction(tmp_path)
