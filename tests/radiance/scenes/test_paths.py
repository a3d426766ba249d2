"""Camera paths of other programs, against matrices worked out by hand."""

import json
import math

import numpy as np
import pytest

from cvkern.radiance import cameras, load_camera_path, project

# A camera 4 to the right of the middle that looks back at it; its up is the world's z.
TO_WORLD = np.array([[0, 0, 1, 4], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)


def write(folder, content):
    file = folder / "camera_path.json"
    file.write_text(json.dumps(content))
    return file


def nerfstudio(**other):
    frame = {"camera_to_world": TO_WORLD.ravel().tolist(), "fov": 60.0, "aspect": 1.5}
    later = {"camera_to_world": TO_WORLD.tolist(), "fov": 90.0}
    return {
        "camera_type": "perspective", "render_height": 40, "render_width": 60, "fps": 24,
        "seconds": 1, "camera_path": [frame, later],
    } | other  # fmt: skip


def test_nerfstudio(tmp_path):
    found = load_camera_path(write(tmp_path, nerfstudio()))
    views = found.cameras
    assert (len(views), views.height, views.width, found.fps) == (2, 40, 60, 24.0)
    middle = 19.5, 29.5
    np.testing.assert_allclose(project(views, 0, np.zeros((1, 3))), [middle])
    # The field of view is that of the height: its upper border is at the angle of 30 degrees.
    top = np.array([[0.0, 0.0, 4 * math.tan(math.radians(30))]])
    np.testing.assert_allclose(project(views, 0, top), [(-0.5, 29.5)], atol=1e-9)
    beside = np.array([[0.0, 1.0, 0.0]])  # to the right, and 20 pixels are a distance of 4
    np.testing.assert_allclose(project(views, 1, beside), [(19.5, 34.5)], atol=1e-9)


def test_frames_of_transforms(tmp_path):
    content = {
        "camera_angle_x": 2 * math.atan(0.5), "w": 80, "h": 40,
        "frames": [{"file_path": "nothing", "transform_matrix": TO_WORLD.tolist()}],
    }  # fmt: skip
    found = load_camera_path(write(tmp_path, content), factor=0.5)
    assert (found.fps, found.cameras.width, found.cameras.height) == (20.0, 40, 20)
    beside = np.array([[0.0, 2.0, 0.0]])  # at the right border
    np.testing.assert_allclose(project(found.cameras, 0, beside), [(9.5, 39.5)], atol=1e-9)


def test_lens_and_size_of_the_photographs(tmp_path):
    views = cameras(np.eye(4)[None], [50, 60, 20, 10], 48, 32, distortion=[0.1, 0, 0, 0, 0])
    content = {"frames": [{"transform_matrix": TO_WORLD.tolist()}]}
    found = load_camera_path(write(tmp_path, content), views).cameras
    assert (found.width, found.height) == (48, 32)
    np.testing.assert_allclose(found.intrinsics, views.intrinsics)
    np.testing.assert_array_equal(found.distortion, views.distortion)


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        ([], "must have camera_path or frames"),
        (nerfstudio(camera_path=[]), "must have camera_path or frames"),
        (nerfstudio(camera_path=[3]), "must have camera_path or frames"),
        (nerfstudio(camera_type="fisheye"), "must have perspective cameras"),
        (nerfstudio(camera_path=[{}]), "must give a transform_matrix"),
        (nerfstudio(camera_path=[{"camera_to_world": [1.0] * 16}]), "must have rotations"),
        (nerfstudio(fps=-1), "must give a finite number > 0 for fps"),
        (nerfstudio(render_width=None), "must give render_width, or views must be given"),
        (nerfstudio(render_width=10**9), "render_width must be in"),
        (
            nerfstudio(camera_path=[{"camera_to_world": TO_WORLD.tolist(), "fov": 180}]),
            "fov below 180",
        ),
    ],
)
def test_errors(tmp_path, content, rule):
    with pytest.raises(ValueError, match=rule):
        load_camera_path(write(tmp_path, content))


def test_other_files(tmp_path):
    file = tmp_path / "path.json"
    with pytest.raises(FileNotFoundError, match="path must be a file that exists"):
        load_camera_path(file)
    file.write_text("{")
    with pytest.raises(ValueError, match="must be JSON"):
        load_camera_path(file)
