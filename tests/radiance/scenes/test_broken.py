"""Broken scenes: the error names the fault and the file."""

import json

import numpy as np
import pytest

from cvkern.images import write_image
from cvkern.radiance import cameras, load_scene, pixel_rays, project
from tests.radiance.scenes.test_photographs import (
    COUNT,
    HEIGHT,
    INTRINSICS,
    WIDTH,
    binary_model,
    instant_ngp,
    llff,
    some_images,
    some_poses,
    text_model,
    write_images,
)


def test_how_many_are_kept_back_is_checked(tmp_path):
    with pytest.raises(ValueError, match=r"test_every must be in \[0, .*\], got -1"):
        load_scene(tmp_path, test_every=-1)
    with pytest.raises(TypeError, match=r"test_every must be an integer, got 2\.5"):
        load_scene(tmp_path, test_every=2.5)  # type: ignore[arg-type]


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="path must be a folder"):
        load_scene(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="path must be a folder of posed photographs, or the JSON"):
        load_scene(__file__)
    with pytest.raises(FileNotFoundError, match=r"transforms\.json, poses_bounds\.npy"):
        load_scene(tmp_path)
    instant_ngp(tmp_path)
    (tmp_path / "images" / "v003.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"v003\.png is missing"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames": []}, "must have frames, got none"),
        ({"fl_x": None}, "must give fl_x, or camera_angle_x"),
        ({"fl_x": None, "camera_angle_x": 4}, r"camera_angle_x in \(0, pi\), got 4"),
        ({"fl_x": -3.0}, r"transforms\.json must give a finite number > 0 for fl_x, got -3\.0"),
        ({"w": 0}, "a finite number > 0 for w, got 0"),
        ({"cx": []}, r"a finite number for cx, got \[\]"),
        ({"k1": float("nan")}, "a finite number for k1, got nan"),
        ({"aabb_scale": 0}, "a finite number > 0 for aabb_scale, got 0"),
        ({"scale": "x"}, "a finite number > 0 for scale, got 'x'"),
        ({"offset": [0, 1]}, r"a finite number for offset, got \[0, 1\]"),
        ({"is_fisheye": True}, "must use one of .*'OPENCV'.*, got fisheye"),
        ({"camera_model": "OPENCV_FISHEYE"}, "must use one of .*, got OPENCV_FISHEYE"),
        ({"frames": {"a": 1}}, "must have a list of objects as frames, got {'a': 1}"),
        ({"frames": [3]}, r"must have a list of objects as frames, got \[3\]"),
        ({"frames": [{"file_path": 3}]}, "must give file_path"),
        ({"frames": [{"file_path": "images/v000"}]}, "must give a transform_matrix"),
        (
            {
                "frames": [
                    {"file_path": "images/v000", "transform_matrix": np.zeros((4, 4)).tolist()}
                ]
            },
            "poses must have rotations, got in view 0",
        ),
    ],
)
def test_broken_instant_ngp(tmp_path, changes, message):
    *_, content = instant_ngp(tmp_path)
    (tmp_path / "transforms.json").write_text(json.dumps(content | changes))
    with pytest.raises(ValueError, match=message):
        load_scene(tmp_path)


def test_broken_files_are_named(tmp_path):
    *_, content = instant_ngp(tmp_path)
    (tmp_path / "transforms.json").write_text(json.dumps(content)[:-20])
    with pytest.raises(ValueError, match=r"transforms\.json must be JSON"):
        load_scene(tmp_path)
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    write_image(tmp_path / "images" / "v004.png", np.zeros((HEIGHT, WIDTH + 1, 3), np.uint8))
    with pytest.raises(ValueError, match=r"must have one size, got .*v004\.png"):
        load_scene(tmp_path)
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    image[3, 4] = np.nan
    (tmp_path / "images" / "v004.png").unlink()
    write_image(tmp_path / "images" / "v004.tif", image)
    content["frames"][4]["file_path"] = "images/v004.tif"
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"must be finite, got NaN or infinity in .*v004\.tif"):
        load_scene(tmp_path)


def test_broken_llff(tmp_path):
    (tmp_path / "poses_bounds.npy").write_bytes(b"no array")
    with pytest.raises(ValueError, match="must be an array of NumPy"):
        load_scene(tmp_path)
    with (tmp_path / "poses_bounds.npy").open("wb") as file:
        np.savez(file, np.zeros((3, 17)))
    with pytest.raises(ValueError, match="must be an array of NumPy"):
        load_scene(tmp_path)
    np.save(tmp_path / "poses_bounds.npy", np.zeros((3, 16)))
    with pytest.raises(ValueError, match=r"of shape \(N, 17\), got \(3, 16\)"):
        load_scene(tmp_path)
    np.save(tmp_path / "poses_bounds.npy", np.zeros((3, 17)))
    with pytest.raises(FileNotFoundError, match="folder 'images'"):
        load_scene(tmp_path)
    write_images(tmp_path / "images", some_images(2))
    with pytest.raises(ValueError, match="must have 3 photographs, got 2"):
        load_scene(tmp_path)


def test_broken_colmap(tmp_path):
    poses = some_poses()
    names = write_images(tmp_path / "images", some_images())
    binary_model(tmp_path / "sparse/0", names, poses)
    file = tmp_path / "sparse/0/images.bin"
    whole = file.read_bytes()
    for end in (3, 40, len(whole) - 5):
        file.write_bytes(whole[:end])
        with pytest.raises(ValueError, match="must be a whole COLMAP model"):
            load_scene(tmp_path)
    file.unlink()
    with pytest.raises(FileNotFoundError, match=r"must have images\.bin"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poses": np.zeros((0, 3, 4))}, r"poses must have shape \(N, 3, 4\)"),
        ({"poses": np.full((1, 3, 4), np.nan)}, "poses must be finite, got view 0"),
        ({"poses": np.diag([1, 1, -1, 1])[None]}, "poses must have rotations"),
        ({"intrinsics": [1, 2, 3]}, r"intrinsics must have shape \(4,\)"),
        ({"intrinsics": np.ones((2, 4))}, "one row for each of 1 views, got 2"),
        ({"distortion": [np.inf, 0, 0, 0, 0]}, "distortion must be finite"),
        ({"width": 0}, r"width must be in \[1, 32768\]"),
    ],
)
def test_bad_cameras(changes, message):
    good = {"poses": np.eye(4)[None], "intrinsics": INTRINSICS, "width": 3, "height": 4}
    with pytest.raises(ValueError, match=message):
        cameras(**(good | changes))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda c: pixel_rays(c, 2, [[0, 0]]), ValueError, r"view must be in \[0, 1\], got 2"),
        (lambda c: pixel_rays(c, -1, [[0, 0]]), ValueError, r"view must be in \[0, 1\], got -1"),
        (lambda c: pixel_rays(c, 0, [1, 2]), ValueError, r"pixels must have shape \(N, 2\), got"),
        (
            lambda c: project(c, c.width / 4, [[0, 0, 1]]),
            TypeError,
            "view must be an integer, got 1.5",
        ),
        (lambda c: project(c, 0, [[1, 2]]), ValueError, r"points must have shape \(N, 3\), got"),
        (lambda c: c.resized(5), ValueError, r"factor must be in \[1, 4\], got 5"),
        (lambda c: c.scaled(0), ValueError, "factor must be > 0, got 0"),
    ],
)
def test_cameras_asked_for_what_is_not_there(call, error, message):
    with pytest.raises(error, match=message):
        call(cameras(np.tile(np.eye(4), (2, 1, 1)), INTRINSICS, 6, 4))


def blender(folder, changes=lambda content: None):
    """Write a scene of Blender, with changes to its JSON."""
    _, _, content = instant_ngp(folder)
    content = {"camera_angle_x": 0.9, "frames": content["frames"]}
    changes(content)
    (folder / "transforms.json").unlink()
    (folder / "transforms_train.json").write_text(json.dumps(content))


def colmap(folder, write, poses):
    """Write a model of COLMAP, and its photographs."""
    names = write_images(folder / "images", some_images(len(poses)))
    write(folder / "sparse/0", names, poses)


@pytest.mark.parametrize("kind", ["blender", "llff", "text", "binary"])
def test_no_frames(tmp_path, kind):
    if kind == "blender":
        blender(tmp_path, lambda content: content.update(frames=[]))
        message = r"transforms_train\.json must have frames, got none"
    else:
        message = "scene must have at least one photograph, got none"
        if kind == "llff":
            (tmp_path / "images").mkdir()
            np.save(tmp_path / "poses_bounds.npy", np.zeros((0, 17)))
        else:
            colmap(tmp_path, text_model if kind == "text" else binary_model, some_poses(2))
            file = tmp_path / "sparse/0" / ("images.txt" if kind == "text" else "images.bin")
            file.write_bytes(b"# none" if kind == "text" else bytes(8))
    with pytest.raises(ValueError, match=message):
        load_scene(tmp_path)


@pytest.mark.parametrize("kind", ["blender", "instant-ngp", "llff", "text", "binary"])
def test_images_of_unequal_size(tmp_path, kind):
    if kind in ("blender", "instant-ngp"):
        {"blender": blender, "instant-ngp": instant_ngp}[kind](tmp_path)
    elif kind == "llff":
        llff(tmp_path)
    else:
        colmap(tmp_path, text_model if kind == "text" else binary_model, some_poses())
    file = tmp_path / "images" / f"v{COUNT - 2:03}.png"
    write_image(file, np.zeros((HEIGHT + 1, WIDTH, 3), np.uint8))
    with pytest.raises(
        ValueError, match=rf"must have one size, got \(13, 20, 3\) in .*{file.name}"
    ):
        load_scene(tmp_path)


@pytest.mark.parametrize("kind", ["blender", "instant-ngp", "llff", "text", "binary"])
def test_images_of_another_shape(tmp_path, kind):
    """Such as a telephone's, which lie on their side: half of the size will do, turned will not."""
    if kind in ("blender", "instant-ngp"):
        sizes = {"w": WIDTH, "h": HEIGHT}
        if kind == "blender":
            blender(tmp_path, lambda content: content.update(sizes))
        else:
            instant_ngp(tmp_path)
        file = "transforms_train.json" if kind == "blender" else "transforms.json"
    elif kind == "llff":
        llff(tmp_path)
        file = "poses_bounds.npy"
    else:
        colmap(tmp_path, text_model if kind == "text" else binary_model, some_poses())
        file = "cameras.txt" if kind == "text" else "cameras.bin"
    for i, shape in enumerate(((HEIGHT // 2, WIDTH // 2, 3), (WIDTH, HEIGHT, 3))):
        for photograph in (tmp_path / "images").iterdir():
            write_image(photograph, np.zeros(shape, np.uint8))
        if i == 0:
            assert load_scene(tmp_path).cameras.width == WIDTH // 2
    with pytest.raises(ValueError, match=rf"{file} must be for photographs .*, 12 x 20, or in"):
        load_scene(tmp_path)


SINGULAR = {
    "flat": np.diag([1.0, 1.0, 0.0]),
    "two axes are one": np.array([[1.0, 1, 0], [0, 0, 0], [0, 0, 1]]),
    "nearly flat": np.array([[1.0, 1, 0], [0, 1e-9, 0], [0, 0, 1]]),
    "mirrored": np.diag([-1.0, 1, 1]),
    "sheared": np.array([[1.0, 0.6, 0], [0, 0.8, 0], [0, 0, 1]]),
}


@pytest.mark.parametrize("turn", SINGULAR.values(), ids=SINGULAR)
@pytest.mark.parametrize("kind", ["blender", "instant-ngp", "llff"])
def test_singular_poses(tmp_path, kind, turn):
    def spoil(content):
        content["frames"][3]["transform_matrix"] = np.block(
            [[turn, np.ones((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]
        ).tolist()

    if kind == "llff":
        table = llff(tmp_path)
        blocks = table[:, :15].reshape(-1, 3, 5)
        blocks[3, :, :3] = turn
        np.save(tmp_path / "poses_bounds.npy", table)
    elif kind == "blender":
        blender(tmp_path, spoil)
    else:
        *_, content = instant_ngp(tmp_path)
        spoil(content)
        (tmp_path / "transforms.json").write_text(json.dumps(content))
    file = {"blender": "transforms_train.json", "instant-ngp": "transforms.json"}.get(
        kind, "poses_bounds.npy"
    )
    with pytest.raises(ValueError, match=rf"{file}: poses must have rotations, got in view 3"):
        load_scene(tmp_path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_poses_that_are_no_numbers(tmp_path, value):
    *_, content = instant_ngp(tmp_path)
    content["frames"][3]["transform_matrix"][1][2] = value
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"transforms\.json must give finite poses, got .* in 3"):
        load_scene(tmp_path)


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_colmap_without_rotation(tmp_path, kind, monkeypatch):
    from tests.radiance.scenes import test_photographs

    poses = some_poses()
    turns, places = test_photographs.colmap_views(poses)
    for wrong in (0.0, np.nan, np.inf):
        turns[4] = wrong
        monkeypatch.setattr(test_photographs, "colmap_views", lambda _: (turns, places))
        folder = tmp_path / str(wrong)
        colmap(folder, text_model if kind == "text" else binary_model, poses)
        with pytest.raises(ValueError, match=r"must have finite poses, got \(.* for v004\.png"):
            load_scene(folder)


@pytest.mark.parametrize("value", [0.0, -5.0])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_llff_without_sizes(tmp_path, which, value):
    table = llff(tmp_path)
    table[2, 4 + 5 * which] = value
    np.save(tmp_path / "poses_bounds.npy", table)
    with pytest.raises(ValueError, match=r"must give heights, widths and focal lengths > 0"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("bounds", "message"),
    [((0.0, 9.0), "0 < near < far, got 0 and 9"), ((3.0, 2.0), "got 2.7 and 2"),
     ((np.nan, 9.0), "must be finite"), ((1.0, np.inf), "must be finite")],
)  # fmt: skip
def test_llff_bounds(tmp_path, bounds, message):
    table = llff(tmp_path)
    table[:, 15:] = bounds
    np.save(tmp_path / "poses_bounds.npy", table)
    with pytest.raises(ValueError, match=message):
        load_scene(tmp_path)


def test_colmap_files_that_are_damaged(tmp_path):
    poses = some_poses()
    colmap(tmp_path / "text", text_model, poses)
    for name, old, new, message in (
        ("cameras", "7 OPENCV", "x OPENCV", r"cameras\.txt must have integers, got 'x'"),
        ("cameras", "7 OPENCV", "7 FISHEYE", "must use one of .*, got FISHEYE"),
        ("cameras", "7 OPENCV", "8 OPENCV", r"must have camera 7, which v000\.png was taken with"),
        ("images", " 7 v", " 7.5 v", r"images\.txt must have integers, got '7\.5'"),
        ("points3D", "0 ", "0 far ", r"points3D\.txt must have numbers, got 'far'"),
        ("points3D", "0 ", "0 inf ", r"points3D\.txt must have finite points"),
    ):
        file = tmp_path / "text/sparse/0" / f"{name}.txt"
        whole = file.read_text()
        file.write_text(whole.replace(old, new, 1))
        with pytest.raises(ValueError, match=message):
            load_scene(tmp_path / "text")
        file.write_text(whole)
    colmap(tmp_path / "binary", binary_model, poses)
    for name in ("cameras", "images", "points3D"):  # more than there are, or than memory holds
        file = tmp_path / "binary/sparse/0" / f"{name}.bin"
        whole = file.read_bytes()
        file.write_bytes((2**62).to_bytes(8, "little") + whole[8:])
        with pytest.raises(ValueError, match="must be a whole COLMAP model"):
            load_scene(tmp_path / "binary")
        file.write_bytes(whole)
    assert len(load_scene(tmp_path / "binary").images) == COUNT


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", [0, 3])
def test_pixels_that_are_no_numbers(tmp_path, value, channel):
    *_, content = instant_ngp(tmp_path)
    image = np.ones((HEIGHT, WIDTH, 4), np.float32)
    image[3, 4, channel] = value
    write_image(tmp_path / "images" / "v000.tif", image)
    content["frames"][0]["file_path"] = "images/v000.tif"
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"must be finite, got NaN or infinity in .*v000\.tif"):
        load_scene(tmp_path)


def test_depths_of_unequal_size(tmp_path):
    blender(tmp_path)
    write_image(tmp_path / "images" / "v002_depth.png", np.zeros((HEIGHT, WIDTH + 1), np.uint8))
    with pytest.raises(ValueError, match=r"v002_depth\.png must be \(12, 20\), got \(12, 21\)"):
        load_scene(tmp_path)


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_colmap_names_photographs_in_its_folder(tmp_path, kind):
    write = text_model if kind == "text" else binary_model
    images = some_images()
    inside, (beside,) = (
        write_images(tmp_path / "a/images", images),
        write_images(tmp_path / "a/other", images[:1]),
    )
    for n, name in enumerate((f"../other/{beside}", str(tmp_path / "a/other" / beside))):
        write(tmp_path / f"a/{n}/sparse", [name, *inside[1:]], some_poses())
        (tmp_path / f"a/{n}/images").symlink_to(tmp_path / "a/images")
        with pytest.raises(
            ValueError, match=r"images\.\w+ must name photographs in its folder, got"
        ):
            load_scene(tmp_path / f"a/{n}")
    assert len(load_scene(tmp_path / "a/1", outside=True)) == COUNT
    write(tmp_path / "a/long/sparse", ["x" * 5000, *inside[1:]], some_poses())
    with pytest.raises(ValueError, match="scene must name photographs, got 'xxx"):
        load_scene(tmp_path / "a/long")
