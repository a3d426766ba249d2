"""Cameras and the loaders of posed photographs, on small scenes that the tests write."""

import json
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from cvkern.images import read_image, write_image
from cvkern.radiance import Bounds, cameras, load_scene, look_at, make_scene, pixel_rays, project
from cvkern.radiance.scenes.photographs import focus_of
from tests.truth import truth

RNG = np.random.default_rng(0)
WIDTH, HEIGHT, COUNT = 20, 12, 9
LENS = [-0.11, 0.04, 0.002, -0.003, 0.01]
INTRINSICS = [19.0, 21.0, 9.2, 5.7]


def some_poses(count=COUNT):
    eyes = RNG.normal(size=(count, 3)) * [1, 1, 0.3] + [0, 0, 2]
    eyes[:, :2] += 3 * np.stack((np.cos(np.arange(count)), np.sin(np.arange(count))), axis=1)
    return look_at(eyes, (0.1, -0.2, 0.3))


def some_images(count=COUNT, channels=3):
    return RNG.integers(0, 256, (count, HEIGHT, WIDTH, channels), np.uint8)


def write_images(folder, images):
    folder.mkdir(parents=True)
    names = [f"v{i:03}.png" for i in range(len(images))]
    for name, image in zip(names, images, strict=True):
        write_image(folder / name, image)
    return names


def opengl(poses):
    """Return 4 x 4 matrices with the axes x right, y up, z backward."""
    full = np.tile(np.eye(4), (len(poses), 1, 1))
    full[:, :3] = poses * [1, -1, -1, 1]
    return full.tolist()


def assert_views(scene, poses, images, intrinsics=INTRINSICS, distortion=(0,) * 5):
    np.testing.assert_array_equal(scene.images, images)
    # Text formats round to nine digits or more; binary ones and JSON do not.
    np.testing.assert_allclose(scene.cameras.poses, poses, atol=1e-7)
    np.testing.assert_allclose(scene.cameras.intrinsics, np.tile(intrinsics, (len(poses), 1)))
    np.testing.assert_allclose(scene.cameras.distortion, np.tile(distortion, (len(poses), 1)))


def test_projection_is_that_of_opencv():
    views = cameras(some_poses(), INTRINSICS, WIDTH, HEIGHT, distortion=LENS)
    fx, fy, cx, cy = INTRINSICS
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    points = RNG.normal(size=(50, 3)) * 0.5
    for view, pose in enumerate(views.poses):
        turn, _ = cv2.Rodrigues(pose[:, :3].T)
        theirs, _ = cv2.projectPoints(
            points, turn, -pose[:, :3].T @ pose[:, 3], matrix, np.array(LENS)
        )
        np.testing.assert_allclose(project(views, view, points)[:, ::-1], theirs[:, 0], atol=1e-9)


def test_cameras_take_matrices():
    K = np.array([[50.0, 0, 31], [0, 52, 23], [0, 0, 1]])
    poses = np.tile(np.eye(4), (2, 1, 1))
    for given in (K, np.stack([K, K])):
        found = cameras(poses, given, 64, 48)
        np.testing.assert_array_equal(found.intrinsics, [[50, 52, 31, 23]] * 2)
    K[0, 1] = 3
    with pytest.raises(ValueError, match="intrinsics must be matrices"):
        cameras(poses, K, 64, 48)


def test_rays_pass_through_what_their_pixels_see():
    views = cameras(some_poses(), INTRINSICS, WIDTH, HEIGHT, distortion=LENS)
    pixels = RNG.uniform([-0.5, -0.5], [HEIGHT - 0.5, WIDTH - 0.5], (40, 2))
    for view in range(len(views)):
        origins, directions = pixel_rays(views, view, pixels)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
        seen = project(views, view, origins + 2.5 * directions)
        np.testing.assert_allclose(seen, pixels, atol=1e-9)


def test_rays_of_pixels_that_no_point_is_seen_at():
    """Behind the fold of a lens Newton's method ends anywhere: rays must have a direction."""
    size = 400
    lens = [size / 2.4, size / 2.4, size / 2, size / 2]
    views = cameras(
        np.eye(3, 4)[None], lens, size, size, distortion=[-0.35, 0.15, 1e-3, 1e-3, -0.03]
    )
    pixels = np.argwhere(np.ones((size, size), bool))
    _, directions = pixel_rays(views, 0, pixels)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=0, atol=1e-12)
    assert (directions[:, 2] >= 0.5e-6).all()
    flat = cameras(np.eye(3, 4)[None], [100, 100, 0, 0], 200, 200, distortion=[-1 / 3, 0, 0, 0, 0])
    _, directions = pixel_rays(flat, 0, [[0, 100]])  # x - x^3 / 3 has no slope there
    np.testing.assert_allclose(directions, [[0.5**0.5, 0, 0.5**0.5]], rtol=0, atol=1e-12)


def test_points_behind_a_camera_are_not_seen():
    views = cameras(np.eye(4)[None], INTRINSICS, WIDTH, HEIGHT)
    assert np.isnan(project(views, 0, [[0, 0, -1], [0, 0, 0]])).all()
    np.testing.assert_allclose(project(views, 0, [[0, 0, 1]]), [[5.7, 9.2]])


def test_resized_cameras_see_the_middle_of_each_block():
    views = cameras(some_poses(), INTRINSICS, WIDTH, HEIGHT)
    small = views.resized(4)
    assert (small.width, small.height) == (5, 3)
    block = np.array([[1, 2]])
    _, large_ray = pixel_rays(views, 0, 4 * block + 1.5)
    _, small_ray = pixel_rays(small, 0, block)
    np.testing.assert_allclose(small_ray, large_ray, atol=1e-12)


def test_look_at_and_the_focus_of_its_cameras():
    poses = some_poses()
    np.testing.assert_allclose(focus_of(poses), (0.1, -0.2, 0.3), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(poses[:, :, :3]), 1)
    assert (poses[:, 2, 1] < 0).all()  # down is down
    with pytest.raises(ValueError, match="not look along up"):
        look_at((0, 0, 1), (0, 0, 0))


@pytest.mark.parametrize("distance", [6.0, -9.0, 1e15])
def test_the_focus_of_cameras_that_look_one_way_is_ahead(distance):
    """Their axes meet at what they look at, behind them, or nowhere."""
    y, z = np.mgrid[-1:2, -1:2].reshape(2, -1).astype(float)
    eyes = np.stack((0 * y, y, z), axis=1)
    ahead = np.sign(distance) * (np.array([distance, 0, 0]) - eyes)
    focus = focus_of(look_at(eyes, eyes + ahead, (0, 0, 1)))
    apart = np.sqrt(4 / 3)  # root of the mean square of their distances from the middle
    np.testing.assert_allclose(focus, (distance if distance == 6 else apart, 0, 0), atol=1e-6)


def test_blender(tmp_path):
    images, poses = some_images(channels=4), some_poses()
    angle = 2 * np.arctan(WIDTH / (2 * 19.0))
    for split, part in (("train", slice(0, 6)), ("test", slice(6, None))):
        names = write_images(tmp_path / split, images[part])
        frames = [
            {"file_path": f"./{split}/{name[:-4]}", "transform_matrix": matrix}
            for name, matrix in zip(names, opengl(poses[part]), strict=True)
        ]
        content = {"camera_angle_x": angle, "frames": frames}
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps(content))
    depth = np.full((HEIGHT, WIDTH), 128, np.uint8)
    depth[0] = 0
    write_image(tmp_path / "test" / "v000_depth_0001.png", depth)
    write_image(tmp_path / "test" / "v001_depth_0001.png", depth * np.uint16(257))
    scene = load_scene(tmp_path)
    assert_views(scene, poses, images, [19.0, 19.0, 9.5, 5.5])
    assert scene.test.tolist() == [False] * 6 + [True] * 3
    assert (scene.bounds, scene.near, scene.far) == (((0, 0, 0), 1.5, False), 2, 6)  # NeRF's
    assert scene.depths is not None
    np.testing.assert_allclose(scene.depths[6:8, 1:], 8 * (1 - 128 / 255), rtol=1e-6)
    assert np.isnan(scene.depths[6:8, 0]).all()
    assert np.isnan(scene.depths[:6]).all()
    small = scene.resized(4)
    assert small.images.shape == (COUNT, 3, 5, 4)
    assert small.depths is not None
    np.testing.assert_array_equal(small.depths, scene.depths[:, 2::4, 2::4])
    solid = images[0, :4, :4].astype(float)
    weights = solid[..., 3:]
    np.testing.assert_allclose(
        small.images[0, 0, 0],
        [*(solid[..., :3] * weights).sum((0, 1)) / weights.sum(), weights.mean()],
        atol=0.5,  # rounded to bytes
    )


def instant_ngp(folder, frames=None, **changes):
    images, poses = some_images(), some_poses()
    names = write_images(folder / "images", images)
    made = [
        {"file_path": f"images/{name}", "transform_matrix": matrix}
        for name, matrix in zip(names, opengl(poses), strict=True)
    ]
    lens = dict(zip(("fl_x", "fl_y", "cx", "cy"), (19.0, 21.0, 9.7, 6.2), strict=True))
    lens |= dict(zip(("k1", "k2", "p1", "p2", "k3"), LENS, strict=True))
    content = lens | {"w": WIDTH, "h": HEIGHT, "aabb_scale": 4, "frames": frames or made} | changes
    (folder / "transforms.json").write_text(json.dumps(content))
    return images, poses, content


def test_instant_ngp(tmp_path):
    images, poses, content = instant_ngp(tmp_path)
    scene = load_scene(tmp_path)
    assert_views(scene, poses, images, distortion=LENS)
    assert np.flatnonzero(scene.test).tolist() == [0, 8]
    assert np.flatnonzero(load_scene(tmp_path, test_every=3).test).tolist() == [0, 3, 6]
    assert not load_scene(tmp_path, test_every=0).test.any()
    assert scene.bounds == ((0, 0, 0), pytest.approx(2 / 0.33), False)
    for i, frame in enumerate(content["frames"]):
        frame["split"] = "test" if i == 4 else "train"
    content |= {"w": 2 * WIDTH, "h": 2 * HEIGHT, "frames": content["frames"][::-1]}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    scene = load_scene(tmp_path / "transforms.json")
    assert_views(scene, poses, images, [9.5, 10.5, 4.35, 2.6], LENS)
    assert np.flatnonzero(scene.test).tolist() == [4]
    # What comes to x times the scale plus the offset lies in the unit cube, here 4 times as large.
    content |= {"scale": 0.5, "offset": [0.5, 0.25, 1.0]}
    (tmp_path / "transforms.json").write_text(json.dumps(content), encoding="utf-8-sig")
    assert load_scene(tmp_path).bounds == ((0, 0.5, -1), 4, False)


def test_photographs_are_not_turned(tmp_path):
    """Whatever they say is up: the lens is that of the file as it is stored."""
    images, poses, _ = instant_ngp(tmp_path)
    for file in (tmp_path / "images").iterdir():
        photograph = Image.open(file)
        exif = photograph.getexif()
        exif[ExifTags.Base.Orientation] = 6
        photograph.save(file, exif=exif)
        assert read_image(file).shape == (WIDTH, HEIGHT, 3)
    assert_views(load_scene(tmp_path), poses, images, distortion=LENS)


def llff(folder, images=None, poses=None):
    """Write a scene of LLFF; return its table."""
    write_images(folder / "images", some_images() if images is None else images)
    poses = some_poses() if poses is None else poses
    blocks = np.stack(
        (poses[:, :, 1], poses[:, :, 0], -poses[:, :, 2], poses[:, :, 3],
         np.tile([2 * HEIGHT, 2 * WIDTH, 38.0], (COUNT, 1))), axis=2
    )  # fmt: skip
    table = np.hstack((blocks.reshape(COUNT, 15), np.tile([1.5, 9.0], (COUNT, 1))))
    np.save(folder / "poses_bounds.npy", table)
    return table


def test_llff(tmp_path):
    images, poses = some_images(), some_poses()
    llff(tmp_path, images, poses)
    scene = load_scene(tmp_path)
    assert_views(scene, poses, images, [19.0, 19.0, 9.5, 5.5])
    assert (scene.near, scene.bounds.unbounded) == (pytest.approx(1.35), True)
    # What is 9 along the axis is farther along the rays to the corners.
    assert scene.far == pytest.approx(9 * np.linalg.norm([WIDTH / 2 / 19, HEIGHT / 2 / 19, 1]))
    np.testing.assert_allclose(scene.bounds.center, (0.1, -0.2, 0.3), atol=1e-6)


def colmap_views(poses):
    """Return quaternion and translation, world to camera, by SciPy."""
    from scipy.spatial.transform import Rotation

    turns = poses[:, :, :3].transpose(0, 2, 1)
    x, y, z, w = Rotation.from_matrix(turns).as_quat().T
    return np.stack((w, x, y, z), axis=1), -(turns @ poses[:, :, 3:])[..., 0]


POINTS = RNG.normal(size=(200, 3)) * 0.2 + [0.1, -0.2, 0.3]


def text_model(folder, names, poses):
    folder.mkdir(parents=True)
    lens = [19.0, 21.0, 9.7, 6.2, *LENS[:4]]
    line = " ".join(map(str, lens))
    (folder / "cameras.txt").write_text(f"# comment\n7 OPENCV {WIDTH} {HEIGHT} {line}\n")
    lines = ["# comment"]
    for i, (name, q, t) in enumerate(zip(names, *colmap_views(poses), strict=True)):
        lines += [f"{i + 1} " + " ".join(f"{v:.17g}" for v in (*q, *t)) + f" 7 {name}"]
        lines += ["" if i % 2 else "1.5 2.5 -1"]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    points = [f"{i} {x} {y} {z} 1 2 3 0.5 1 2" for i, (x, y, z) in enumerate(POINTS)]
    (folder / "points3D.txt").write_text("\n".join(points))


def binary_model(folder, names, poses):
    folder.mkdir(parents=True)
    lens = [19.0, 21.0, 9.7, 6.2, *LENS[:4]]
    head = struct.pack("<QiiQQ", 1, 7, 4, WIDTH, HEIGHT)
    (folder / "cameras.bin").write_bytes(head + struct.pack("<8d", *lens))
    data = struct.pack("<Q", len(names))
    for i, (name, q, t) in enumerate(zip(names, *colmap_views(poses), strict=True)):
        data += struct.pack("<i7di", i + 1, *q, *t, 7) + name.encode() + b"\0"
        data += struct.pack("<Q", i) + i * struct.pack("<ddq", 1.5, 2.5, -1)
    (folder / "images.bin").write_bytes(data)
    data = struct.pack("<Q", len(POINTS))
    for i, point in enumerate(POINTS):
        data += struct.pack("<Q3d3Bd", i, *point, 1, 2, 3, 0.5)
        data += struct.pack("<Q", i % 3) + (i % 3) * struct.pack("<ii", 1, 2)
    (folder / "points3D.bin").write_bytes(data)


@pytest.mark.parametrize("write", [text_model, binary_model])
@pytest.mark.parametrize("where", ["sparse/0", "sparse", "."])
def test_colmap(tmp_path, write, where):
    images, poses = some_images(), some_poses()
    names = write_images(tmp_path / "images", images)
    order = RNG.permutation(COUNT)  # COLMAP's files are in no order
    folder = tmp_path / where
    if where == ".":
        write(tmp_path / "model", [names[i] for i in order], poses[order])
        for file in (tmp_path / "model").iterdir():
            file.rename(tmp_path / file.name)
    else:
        write(folder, [names[i] for i in order], poses[order])
    scene = load_scene(tmp_path)
    assert_views(scene, poses, images, distortion=[*LENS[:4], 0])
    depths = ((POINTS[None] - poses[:, None, :, 3]) * poses[:, None, :, 2]).sum(axis=2)
    # A tenth of a percent of the points may be astray, on either side; behind is another half.
    low, high = np.quantile(depths[depths > 0], [0.001, 0.999])
    assert (scene.near, scene.far) == (pytest.approx(0.8 * low), pytest.approx(1.5 * high))


@pytest.mark.parametrize(
    ("model", "parameters", "distortion"),
    [
        ("SIMPLE_PINHOLE", [20, 9.7, 6.2], [0, 0]),
        ("PINHOLE", [20, 20, 9.7, 6.2], [0, 0]),
        ("SIMPLE_RADIAL", [20, 9.7, 6.2, 0.1], [0.1, 0]),
        ("RADIAL", [20, 9.7, 6.2, 0.1, 0.02], [0.1, 0.02]),
    ],
)
def test_colmap_lenses(tmp_path, model, parameters, distortion):
    poses = some_poses(2)
    images = some_images(2)
    names = write_images(tmp_path / "images", images)
    text_model(tmp_path / "sparse", names, poses)
    line = " ".join(map(str, parameters))
    (tmp_path / "sparse/cameras.txt").write_text(f"7 {model} {WIDTH} {HEIGHT} {line}\n")
    scene = load_scene(tmp_path)
    assert_views(scene, poses, images, [20, 20, 9.2, 5.7], [*distortion, 0, 0, 0])


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"images": np.zeros((3, 8, 8, 3), np.float32)}, TypeError, "images must be uint8, got"),
        (
            {"images": np.zeros((2, 8, 8, 3), np.uint8)},
            ValueError,
            r"images must have shape \(3, 8",
        ),
        ({"images": np.zeros((3, 8, 9, 3), np.uint8)}, ValueError, r"got \(3, 8, 9, 3\)"),
        ({"images": np.zeros((3, 8, 8, 2), np.uint8)}, ValueError, r"got \(3, 8, 8, 2\)"),
        ({"test": np.array([0, 1, 0])}, TypeError, "test must be bool, got int64"),
        ({"test": np.zeros(2, bool)}, ValueError, r"test must have shape \(3,\), got \(2,\)"),
        ({"depths": np.zeros((3, 8, 9))}, ValueError, r"depths must have shape \(3, 8, 8\), got"),
        ({"bounds": Bounds((0, 0, 0), 0.0, False)}, ValueError, "bounds must be finite with half"),
        ({"bounds": Bounds((0, 0, np.nan), 1.0, False)}, ValueError, "bounds must be finite with"),
        ({"near": 3.0, "far": 2.0}, ValueError, r"near must be >= 0 and below far, got 3\.0 and 2"),
        ({"near": np.nan}, ValueError, "near must be >= 0 and below far, got nan"),
    ],
)
def test_scenes_of_ones_own_are_checked(changes, error, message):
    with pytest.raises(error, match=message):
        replace(make_scene(train=2, test=1, size=8), **changes)


def test_real_scenes():
    for name, shape, tests in (("lego", (200, 200, 4), 25), ("fox", (480, 270, 3), 8)):
        scene = load_scene(truth("nerf") / name)
        assert scene.images.shape[1:] == shape
        assert scene.test.sum() == tests
