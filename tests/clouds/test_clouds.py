"""Point clouds as files and as pictures."""

import importlib.util
import struct
import tracemalloc
from typing import Any

import cv2
import numpy as np
import pytest
import scipy.ndimage as ndi
from PIL import Image

import cvkern
from cvkern._runtime import KERNEL_SETS
from cvkern.clouds import read_ply, turntable, write_animation, write_ply
from tests.clouds import reference_clouds as reference
from tests.primitives import Primitives

F32, I64, U8 = np.float32, np.int64, np.uint8


def scene(count=300, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.normal((0.2, -0.1, 5), (1.5, 1, 1.5), (count, 3)).astype(F32)
    return points, rng.integers(0, 256, (count, 3), U8)


def columns_of(path):
    """Return the columns of a PLY file by name, read by what its head says, byte by byte."""
    head, found, body = path.read_bytes().partition(b"end_header\n")
    assert found
    first, form, *rest = head.decode("ascii").splitlines()
    assert (first, form) == ("ply", "format binary_little_endian 1.0")
    word, name, count = rest.pop(0).split()
    assert (word, name) == ("element", "vertex")
    assert all(line.split()[0] == "property" for line in rest)
    kinds = {"float": "f", "uchar": "B"}
    names, row = [r.split()[2] for r in rest], "<" + "".join(kinds[r.split()[1]] for r in rest)
    assert len(body) == int(count) * struct.calcsize(row)
    return dict(zip(names, zip(*struct.iter_unpack(row, body), strict=True), strict=True))


# ------------------------------------------------------------------------------------------- files


def test_ply(backend, tmp_path):
    points, colors = scene()
    write_ply(tmp_path / "a.ply", points, colors)
    read = columns_of(tmp_path / "a.ply")
    assert list(read) == ["x", "y", "z", "red", "green", "blue"]
    np.testing.assert_array_equal(np.array([read[k] for k in "xyz"], F32).T, points)
    np.testing.assert_array_equal(np.array([read[k] for k in ("red", "green", "blue")]).T, colors)
    write_ply(tmp_path / "b.PLY", points.astype(np.float64)[::-1])
    read = columns_of(tmp_path / "b.PLY")
    np.testing.assert_array_equal(np.array([read[k] for k in "xyz"], F32).T, points[::-1])
    assert len(read) == 3


def test_ply_with_a_head_that_claims_much(tmp_path):
    """No more is allocated than the file has."""
    extra = "".join(f"property double p{n}\n" for n in range(200))
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000\n"
    head += f"property float x\nproperty float y\nproperty float z\n{extra}end_header\n"
    (tmp_path / "a.ply").write_bytes(head.encode() + bytes(5000))
    tracemalloc.start()
    with pytest.raises(ValueError, match="path must have 1000000 points as it says, got 3"):
        read_ply(tmp_path / "a.ply")
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_of_others(tmp_path, form):
    """More properties, doubles, and faces after the points."""
    points, colors = scene(5)
    kind = [("x", "f8"), ("y", "f8"), ("z", "f8"), ("nx", "f4")] + [(c, "u1") for c in "rgb"]
    table = np.zeros(5, [(n, k if k == "u1" else ">" + k) for n, k in kind])
    for k in range(3):
        table["xyz"[k]], table["rgb"[k]] = points[:, k], colors[:, k]
    names = {"f8": "double", "f4": "float", "u1": "uint8"}
    full = dict(zip("rgb", ("red", "green", "blue"), strict=True))
    lines = [f"property {names[k]} {full.get(n, n)}" for n, k in kind]
    head = "\n".join(["ply", f"format {form} 1.0", "comment here", "element vertex 5", *lines,
                      "element face 1", "property list uchar int v", "end_header"])  # fmt: skip
    if form == "binary_little_endian":
        table = table.astype(np.dtype(kind))
    body = table.tobytes()
    if form == "ascii":
        body = "".join(" ".join(repr(v) for v in row) + "\n" for row in table.tolist()).encode()
    (tmp_path / "a.ply").write_bytes(head.encode() + b"\n" + body + b"3 0 1 2\n")
    got = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(got[0], points)
    np.testing.assert_array_equal(got[1], colors)


def test_ply_that_is_none(tmp_path):
    file = tmp_path / "a.ply"
    with pytest.raises(FileNotFoundError, match="path must be a file that exists"):
        read_ply(file)
    write_ply(file, scene(9)[0])
    whole = file.read_bytes()
    faces = whole.replace(b"vertex", b"face")
    many = whole.replace(b"vertex 9", b"vertex 999999999999")
    for content in (
        b"",
        b"x" * 90,
        whole[:70],
        whole[:-1],
        faces,
        whole.replace(b" x", b" q"),
        many,
    ):
        file.write_bytes(content)
        with pytest.raises(ValueError, match=r"path must (be a PLY file of points|have 9)"):
            read_ply(file)


def test_ply_of_tensors(tmp_path):
    torch = pytest.importorskip("torch")
    points, colors = scene(20)
    write_ply(tmp_path / "a.ply", points, colors)
    write_ply(tmp_path / "b.ply", torch.from_numpy(points), torch.from_numpy(colors))
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_a_file_that_cannot_be_written_stays(tmp_path):
    for name, write in (
        ("a.ply", lambda path: write_ply(path, [[0, 0, np.nan]])),
        ("a.gif", lambda path: write_animation(path, np.zeros((2, 3, 4)))),
    ):
        path = tmp_path / name
        path.write_text("old")
        with pytest.raises(ValueError, match="must be"):
            write(path)
        assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 2
    with pytest.raises(FileNotFoundError, match="path must lie in a folder that exists"):
        write_ply(tmp_path / "none" / "a.ply", [[0, 0, 1]])


def test_gif(tmp_path):
    frames = np.zeros((5, 30, 40, 3), U8)
    for k in range(5):
        frames[k, :, 8 * k : 8 * k + 8] = 250, 40 * k, 7
    write_animation(tmp_path / "a.gif", frames, fps=12.5)
    with Image.open(tmp_path / "a.gif") as movie:
        assert movie.n_frames == 5
        assert movie.info["loop"] == 0
        for k in range(5):
            movie.seek(k)
            assert movie.info["duration"] == 80
            np.testing.assert_array_equal(np.asarray(movie.convert("RGB")), frames[k])


def test_mp4(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    frames = np.zeros((6, 32, 48, 3), U8)
    frames[3:] = 200, 100, 50
    write_animation(tmp_path / "a.mp4", frames, fps=10)
    movie = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert movie.get(cv2.CAP_PROP_FPS) == 10
    read = np.array([movie.read()[1][..., ::-1] for _ in frames])
    assert read.shape == frames.shape
    assert not movie.read()[0]
    # Eight bits of luma and half as many of colour, compressed: within a few grey levels.
    assert np.abs(read[[0, 5]].astype(int) - frames[[0, 5]]).max() < 12


def test_mp4_is_refused(tmp_path, monkeypatch):
    frames = np.zeros((6, 32, 48, 3), U8)
    with pytest.raises(ValueError, match=r"^frames must have an even height and width for \.mp4"):
        write_animation(tmp_path / "a.mp4", frames[:, 1:])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match="MP4 needs imageio-ffmpeg: pip install"):
        write_animation(tmp_path / "b.mp4", frames)
    assert not (tmp_path / "b.mp4").exists()


# ---------------------------------------------------------------------------------------- pictures


@pytest.fixture(params=["cpu", "cuda:0"], scope="module")
def device(request):
    return request.param


@pytest.mark.parametrize("name", KERNEL_SETS)
@pytest.mark.parametrize("size", [0.3, 1.0, 4.7, 90.0])
def test_primitives(name, device, size):
    kernels = Primitives(name, device)
    points, colors = scene()
    points[10] = points[11]  # at one place
    points[20:24] = [[0, 0, 0], [1, 1, -3], [0, 0, 1e-20], [3e37, 0, 1]]
    turn = np.deg2rad(20)
    pose = np.array([[np.cos(turn), 0, np.sin(turn), -1.7], [0, 1, 0, 0.1],
                     [-np.sin(turn), 0, np.cos(turn), 0.3]], F32)  # fmt: skip
    lens, shape = (61.3, 40.2, 29.9), (62, 84)
    keys = kernels("clouds.turntables.splat", points, pose, *lens, size, out=[(shape, I64)])
    want = reference.splat(points, pose, *lens, size, shape)
    np.testing.assert_array_equal(keys, want)
    assert (want != reference.FAR).mean() > 0.01
    background = np.array([1, 200, 30], U8)
    for samples in (1, 2):
        height, width = (n // samples for n in shape)
        image = kernels(
            "clouds.turntables.shade",
            keys,
            colors,
            background,
            samples,
            out=[((height, width, 3), U8)],
        )
        np.testing.assert_array_equal(image, reference.shade(want, colors, background, samples))


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_points_behind_either_camera_are_not_drawn(name, device):
    kernels = Primitives(name, device)
    points = np.array([[0, 0, -1], [0, 0, 0], [0, 0, 4], [0, 0, 8]], F32)
    for shift, seen in ((2.0, 2), (-5.0, 3), (-9.0, None)):
        pose = np.eye(3, 4, dtype=F32)
        pose[2, 3] = shift
        keys = kernels(
            "clouds.turntables.splat", points, pose, 50.0, 3.0, 3.0, 2.0, out=[((7, 7), I64)]
        )
        drawn = keys[keys != reference.FAR] & 0x7FFFFFFF
        assert set(drawn) == (set() if seen is None else {seen})


@pytest.mark.parametrize("name", KERNEL_SETS)
@pytest.mark.parametrize("size", [0.05, 0.3])
def test_points_at_the_rim_are_drawn(name, device, size):
    """However small, a point is drawn at the sample that it is nearest to."""
    kernels = Primitives(name, device)
    y, x = np.mgrid[:6, :9].reshape(2, -1)
    rng = np.random.default_rng(0)
    at = np.stack([x, y], 1) + rng.uniform(-0.3, 0.3, (54, 2))
    points = np.c_[at / 50, np.ones(54)].astype(F32)
    pose = np.eye(3, 4, dtype=F32)
    keys: Any = kernels(
        "clouds.turntables.splat", points, pose, 50.0, 0.0, 0.0, size, out=[((6, 9), I64)]
    )
    np.testing.assert_array_equal(keys.ravel() & 0x7FFFFFFF, np.arange(54))


def plane(rows, columns, depth):
    """Return a grid of points that a camera with a focal length of 100 sees a pixel apart."""
    y, x = np.mgrid[:rows, :columns].reshape(2, -1)
    away = np.full(y.size, float(depth))
    return np.stack([(x - columns / 2) * depth / 100, (y - rows / 2) * depth / 100, away], 1)


def test_the_first_frame_is_what_the_camera_saw(backend):
    picture = np.kron(np.random.default_rng(0).integers(0, 256, (6, 8, 3)), np.ones((8, 8, 1)))
    picture = picture.astype(U8)
    points = plane(48, 64, 3.0)
    (frame,) = turntable(points, picture.reshape(-1, 3), shape=(96, 128), frames=1)
    shown = (frame != (16, 17, 20)).any(-1)
    rows, columns = (np.flatnonzero(shown.any(axis)) for axis in (1, 0))
    # The margin is 12 % of the picture, equal on all sides; quantiles leave out a pixel or so of
    # the plane, and points at its rim are some three pixels wide.
    assert 0 <= len(rows) - 96 / 1.12 < 5
    assert 0 <= len(columns) - 128 / 1.12 < 5
    assert rows[0] == 95 - rows[-1]
    assert columns[0] == 127 - columns[-1]
    assert shown[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()  # and no holes
    y = rows[0] + (np.arange(6) + 0.5) * len(rows) / 6
    x = columns[0] + (np.arange(8) + 0.5) * len(columns) / 8
    seen = frame[np.ix_(y.astype(int), x.astype(int))]
    np.testing.assert_array_equal(seen, picture[4::8, 4::8])


def test_no_holes_while_it_swings(backend):
    points = plane(60, 80, 3.0)
    movie = turntable(points, np.full((len(points), 3), 255, U8), shape=(60, 80), frames=8)
    for frame in movie:
        drawn = (frame == 255).all(-1)
        assert drawn.mean() > 0.4
        np.testing.assert_array_equal(drawn, ndi.binary_fill_holes(drawn))


def test_the_nearest_is_seen_and_all_round(backend):
    front, back = plane(9, 9, 1.0), plane(9, 9, 1.4)
    red, blue = np.full((81, 3), (255, 0, 0), U8), np.full((81, 3), (0, 0, 255), U8)
    options = {"shape": (40, 40), "frames": 2, "swing": 180}
    for points, colors in (
        (np.concatenate([front, back]), np.concatenate([red, blue])),
        (np.concatenate([back, front]), np.concatenate([blue, red])),
    ):
        first, half = turntable(points, colors, **options)
        np.testing.assert_array_equal(first[20, 20], red[0])
        np.testing.assert_array_equal(half[20, 20], blue[0])


@pytest.mark.parametrize("swing", [60.0, 180.0])
def test_the_camera_turns_by_the_angle(backend, swing):
    """A quarter of the loop turns by the swing, or by 90 degrees all round."""
    points = plane(60, 80, 3.0)
    white = np.full((len(points), 3), 255, U8)
    movie = turntable(points, white, shape=(60, 80), frames=8, swing=swing)
    widths = (movie == 255).all(axis=-1).any(axis=1).sum(axis=1)
    for k in range(8):
        turn = 2 * np.pi * k / 8
        angle = turn if swing == 180 else np.deg2rad(swing) * np.sin(turn)
        # The plane is 2.4 wide at a distance of 3, so perspective makes it wider by a share of up
        # to (1.2 / 3)^2; points are drawn some three pixels wide.
        want = widths[0] * abs(np.cos(angle))
        assert -3 <= widths[k] - want < 5 + 0.16 * want


def test_of_points_at_one_place_the_first_is_seen(backend):
    points = np.concatenate([plane(9, 9, 1.0)] * 2)
    colors = np.repeat(np.array([[0, 255, 0], [255, 0, 0]], U8), 81, 0)
    (frame,) = turntable(points, colors, shape=(40, 40), frames=1)
    np.testing.assert_array_equal(frame[20, 20], colors[0])


def test_turntable_options():
    points, colors = scene()
    plain = turntable(points, colors, shape=(50, 60), frames=3)
    assert plain.shape == (3, 50, 60, 3)
    assert (plain[0] != plain[1]).any()
    fat = turntable(points, colors, shape=(50, 60), frames=3, point_size=8)
    assert (fat == (16, 17, 20)).all(-1).mean() < (plain == (16, 17, 20)).all(-1).mean()
    white = turntable(points, colors, shape=(50, 60), frames=3, background=(255, 255, 255))
    assert white[0, 0, 0].tolist() == [255] * 3
    behind = np.concatenate([points, -points]), np.concatenate([colors, colors])
    size = {"shape": (50, 60), "frames": 3, "point_size": 2}
    np.testing.assert_array_equal(turntable(*behind, **size), turntable(points, colors, **size))
    with cvkern.use(backend="taichi"):
        other = turntable(points, colors, shape=(50, 60), frames=3)
    np.testing.assert_array_equal(plain, other)
