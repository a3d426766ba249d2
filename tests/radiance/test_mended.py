"""Defects found by users and broken files: each test failed before its defect was fixed."""

import inspect
import json
import time
import zipfile

import numpy as np
import pytest

import cvkern
from cvkern.radiance import (
    HashField,
    Scene,
    fit,
    load_model,
    load_scene,
    make_scene,
    mesh,
    surfaces,
)
from cvkern.radiance.trainer import Trainer

TINY = HashField(levels=8, table_bits=10, samples=2**12, rays=64, cells=32)


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=3, test=1, size=16)


def test_the_schedule_ends_with_the_time_on_slow_machines(scene, monkeypatch):
    seen, step = [], Trainer.repeat

    def slow(self):
        step(self)
        time.sleep(0.1)
        seen.append(float(self.rt.to_numpy(self.learning.progress)[0]))

    monkeypatch.setattr(Trainer, "repeat", slow)
    model = fit(scene, TINY, seconds=0.8)
    assert len(seen) < 16  # steps between other looks at the device
    assert seen[-1] > 0.6  # the last step begins up to 0.1 s before the end, and may take longer
    assert model.training.progress == 1


def transforms(folder, scale=1.0, shift=(0, 0, 0), name="transforms", **more):
    """Write a scene of twelve photographs that look at one point, in units of its own."""
    made = make_scene(train=12, test=0, size=8)
    turn = np.diag([1.0, -1.0, -1.0])
    frames = []
    for n, (pose, image) in enumerate(zip(made.cameras.poses, made.images, strict=True)):
        cvkern.images.write_image(folder / f"{n}.png", image)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose[:, :3] @ turn, scale * pose[:, 3] + shift
        frames.append({"file_path": f"{n}.png", "transform_matrix": matrix.tolist()})
    content = {"fl_x": float(made.cameras.intrinsics[0, 0]), "frames": frames, **more}
    (folder / f"{name}.json").write_text(json.dumps(content))
    return made


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_bounds_come_from_the_cameras_where_a_file_has_none(tmp_path, scale):
    made = transforms(tmp_path, scale)
    found = load_scene(tmp_path)
    # The solids fill most of what the cameras see, and the cube is as large as that.
    np.testing.assert_allclose(
        found.bounds.center, scale * np.array(made.bounds.center), atol=0.5 * scale
    )
    assert 0.5 < found.bounds.half / (scale * made.bounds.half) < 2
    assert not found.bounds.unbounded


@pytest.mark.parametrize(("scale", "shift"), [(10.0, (0, 0, 0)), (0.1, (0, 0, 0)), (1, (5, -3, 2))])
def test_scenes_of_blender_in_other_units(tmp_path, scale, shift):
    made = transforms(tmp_path, scale, shift, "transforms_train")
    found = load_scene(tmp_path)
    middle = scale * np.array(made.bounds.center) + shift
    np.testing.assert_allclose(found.bounds.center, middle, atol=0.5 * scale)
    assert 0.5 < found.bounds.half / (scale * made.bounds.half) < 2
    assert found.near < scale * np.linalg.norm(made.cameras.poses[:, :, 3], axis=1).min() / 2
    assert found.far == np.inf


def test_cameras_that_look_past_the_cube_are_told_of(tmp_path):
    transforms(tmp_path, aabb_scale=1, scale=1.0, offset=[50.0, 0.5, 0.5])
    with pytest.warns(UserWarning, match="100% of the cameras look past the scene's cube"):
        load_scene(tmp_path)


def test_photographs_are_read_from_the_folder_alone(tmp_path):
    inside = tmp_path / "scene"
    inside.mkdir()
    transforms(inside)
    content = json.loads((inside / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["file_path"] = f"../{frame['file_path']}"
        (inside / frame["file_path"][3:]).rename(tmp_path / frame["file_path"][3:])
    (inside / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"must name photographs in its folder, got '\.\./0\.png'"):
        load_scene(inside)
    assert len(load_scene(inside, outside=True)) == 12


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"frames": [{"file_path": "%s"}]}' % ("x" * 5000)]
)
def test_scene_files_that_no_one_writes(tmp_path, text):
    (tmp_path / "transforms.json").write_text(text)
    with pytest.raises(ValueError, match=r"transforms\.json must"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("color", "chosen"),
    [((255, 255, 255), "white"), ((0, 0, 0), "black"), ((9, 99, 200), "learnt")],
)
def test_a_background_of_one_colour_is_found(scene, color, chosen):
    opacity = scene.images[..., 3:] / 255
    flat = scene.images[..., :3] * opacity + np.array(color) * (1 - opacity)
    flat[:, [0, -1]] = color
    flat[:, :, [0, -1]] = color
    parts = scene.cameras, scene.test, scene.bounds, scene.near, scene.far
    photographs = Scene(np.round(flat).astype(np.uint8), *parts)
    with pytest.warns(UserWarning, match=f"background is '{chosen}'"):
        model = fit(photographs, TINY, steps=1)
    assert model.background == chosen
    # The first step of Adam changes a learnt colour by its rate, 1e-3, and float32 rounds it.
    np.testing.assert_allclose(model.behind, np.array(color) / 255, atol=1.1e-3)
    assert fit(photographs, TINY, steps=1, background="random").background == "random"
    assert fit(scene, TINY, steps=1).background == "random"  # it has opacity


def test_a_mesh_is_its_largest_piece():
    axis = np.linspace(-1, 1, 33)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    measure = pytest.importorskip("skimage.measure")
    balls = [(0.0, 0.0, 0.0, 0.4), (0.7, 0.7, 0.7, 0.2), (-0.7, 0.7, 0.7, 0.15)]
    field = np.max([r - np.sqrt((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2)
                    for a, b, c, r in balls], axis=0)  # fmt: skip
    points, faces, _, _ = measure.marching_cubes(field, 0.0)
    side = 2 / 32
    for pieces, radii in ((1, [0.4]), (2, [0.4, 0.2]), (9, [0.4, 0.2, 0.15])):
        at, corners = surfaces._chosen(points, faces, np.ones(len(points), bool), pieces)
        a, b, c = side * at[corners.T]
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        # Triangles between points on a ball are within it: 3 % for a radius of 2.4 cells.
        assert area == pytest.approx(4 * np.pi * np.square(radii).sum(), rel=0.05)
        assert set(corners.ravel()) == set(range(len(at)))
    assert inspect.signature(mesh).parameters["pieces"].default == 1


def test_a_picture_is_not_a_model(tmp_path):
    cvkern.images.write_image(tmp_path / "a.png", np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="path must be a model of cvkern, got"):
        load_model(tmp_path / "a.png")


def test_entries_of_a_model_are_looked_at_before_they_are_read(scene, tmp_path):
    fit(scene, TINY, steps=1).save(tmp_path / "model.npz")
    deflated = zipfile.ZipFile(tmp_path / "model.npz", "a", zipfile.ZIP_DEFLATED)
    with deflated as archive, archive.open("surplus.npy", "w", force_zip64=True) as file:
        np.lib.format.write_array(file, np.zeros(2**20))
    with pytest.raises(ValueError, match="must not have an entry 'surplus'"):
        load_model(tmp_path / "model.npz")
    stored = zipfile.ZipFile(tmp_path / "claim.npz", "w")
    with stored as archive, archive.open("header.npy", "w") as file:
        header = {"descr": "|u1", "fortran_order": False, "shape": (2**40,)}
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ValueError, match=f"header must have the {2**40} bytes"):
        load_model(tmp_path / "claim.npz")


def test_logs_have_lines(scene, monkeypatch, capsys):
    monkeypatch.setattr("cvkern.radiance.progress.LINE", 0.0)
    fit(scene, TINY, steps=17)
    assert "rays/s" in capsys.readouterr().err
