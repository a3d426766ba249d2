"""``cvkern stereo``: what it writes, says and refuses."""

import numpy as np
import pytest
from PIL import Image

import cvkern
from cvkern.images import read_image, write_image
from profiling.case import TOY
from profiling.cases.stereo import matching as pairs
from tests.clouds.test_clouds import columns_of

CAMERA = {"focal": 200.0, "baseline": 0.5, "doffs": 1.5}
WORDS = [word for name, value in CAMERA.items() for word in (f"--{name}", value)]
PLAIN = ["disparity-x256.png", "disparity.png"]
DEEP = [*PLAIN[:1], "cloud.ply", "depth.tif", *PLAIN[1:], "turntable.gif"]


@pytest.fixture(scope="module")
def made():
    return pairs.pair(TOY, np.random.default_rng(5))


@pytest.fixture
def pair(tmp_path, made):
    """Write two views of boards whose disparities are known."""
    for name, view in zip(("left", "right"), made, strict=True):
        write_image(tmp_path / f"{name}.png", view)
    return tmp_path / "left.png", tmp_path / "right.png"


def names(folder):
    return sorted(file.name for file in folder.iterdir() if file.suffix != ".mp4")


def test_everything(command, pair, made, tmp_path):
    out = tmp_path / "new" / "folder"
    code, said, _ = command("stereo", *pair, "-o", out, "--max-disparity", 16, *WORDS)
    assert code == 0
    assert names(out) == sorted(DEEP)
    found = cvkern.stereo_match(made[0], made[1], (0, 16))
    valid = found.valid
    # Measured: 1.3 %, and up to 2.0 % with other noise, all at the rims of boards.
    assert pairs.bad((found.disparity,), (pairs.truth(TOY),)) < 0.03
    assert f"{valid.mean():.1%} of 96 x 128 pixels matched" in said

    assert read_image(out / "disparity.png").shape == (96, 128, 3)
    steps = read_image(out / "disparity-x256.png")
    assert steps.dtype == np.uint16
    np.testing.assert_array_equal(steps > 0, valid)
    # The file rounds to steps of 1/256 pixel. Measured: half a step at most.
    got = steps[valid] / 256
    np.testing.assert_allclose(got, found.disparity[valid], rtol=0, atol=0.5 / 256)

    depth = read_image(out / "depth.tif")
    np.testing.assert_array_equal(np.isfinite(depth), valid)
    want = cvkern.disparity_to_depth(found.disparity, **CAMERA)
    np.testing.assert_array_equal(depth[valid], want[valid])
    assert f"depth.tif: {want[valid].min():.6g} to {want[valid].max():.6g}" in said

    cloud = columns_of(out / "cloud.ply")
    assert f"cloud.ply: {valid.sum()} points" in said
    np.testing.assert_allclose(cloud["z"], depth[valid], rtol=1e-6)
    row, column = np.nonzero(valid)
    # x = (column - middle) z / focal, and y alike: the middle of the image is the default.
    np.testing.assert_allclose(cloud["x"], (column - 63.5) * depth[valid] / 200, atol=1e-4)
    np.testing.assert_allclose(cloud["y"], (row - 47.5) * depth[valid] / 200, atol=1e-4)
    np.testing.assert_array_equal(cloud["green"], made[0][valid])
    with Image.open(out / "turntable.gif") as movie:
        assert movie.n_frames == 60


def test_without_a_camera(command, pair, tmp_path):
    out = tmp_path / "out"
    code, said, _ = command("stereo", *pair, "-o", out, "--max-disparity", 16)
    assert code == 0
    assert names(out) == PLAIN
    assert "no depth: that needs --focal and --baseline, or --calibration" in said


@pytest.mark.parametrize("options", [("--min-disparity", -2), ("--max-disparity", 300)])
def test_disparities_that_16_bits_do_not_hold(command, tmp_path, options):
    rng = np.random.default_rng(0)
    view = rng.integers(0, 256, (30, 320), np.uint8)
    paths = tmp_path / "left.png", tmp_path / "right.png"
    write_image(paths[0], view)
    write_image(paths[1], np.roll(view, -3, axis=1))
    out = tmp_path / "out"
    assert command("stereo", *paths, "-o", out, "--max-disparity", 16, *options)[0] == 0
    assert names(out) == ["disparity.png", "disparity.tif"]
    disparity = read_image(out / "disparity.tif")
    assert disparity.dtype == np.float32
    assert abs(np.nanmedian(disparity) - 3) < 0.1
    found = cvkern.stereo_match(
        view, np.roll(view, -3, axis=1),
        (-2, 16) if options[0] == "--min-disparity" else (0, 300),
    )  # fmt: skip
    np.testing.assert_array_equal(np.isnan(disparity), ~found.valid)


def test_colour_methods_and_the_other_kernels(command, made, tmp_path):
    paths = [tmp_path / f"{name}.png" for name in ("left", "right")]
    colour = [np.stack([v, 255 - v, v // 2], -1) for v in made]
    write_image(paths[0], np.dstack([colour[0], np.full(TOY, 255, np.uint8)]))  # alpha is ignored
    write_image(paths[1], colour[1])
    options = ["--max-disparity", 16, "--method", "window", "--backend", "taichi"]
    assert command("stereo", *paths, "-o", tmp_path / "out", *options)[0] == 0
    left, right = colour
    found = cvkern.stereo_match(left, right, (0, 16), method="window", channel_axis=-1)
    steps = read_image(tmp_path / "out" / "disparity-x256.png")
    np.testing.assert_array_equal(steps > 0, found.valid)


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["none.png", "right.png"], "path must be a file that exists, got 'none.png'"),
        (["left.png", "small.png"], "right must have the shape of left"),
        (["left.png", "right.png", "--focal", "9"], "focal must be given with baseline, got 9.0"),
        (["left.png", "right.png", "--doffs", "9"], "doffs, cx and cy must go with focal"),
        (["left.png", "right.png", "--focal", "-1", "--baseline", "1"], "focal must be > 0"),
        (["left.png", "right.png", "--focal", "1", "--baseline", "0"], "baseline must be > 0"),
        (["left.png", "right.png", "--method", "odd"], "method must be"),
        (["left.png", "right.png", "--paths", "5"], "paths must be"),
        (["left.png", "right.png", "--max-disparity", "0"], "disparities must"),
        (["left.png", "right.png", "--max-disparity", "999"], "disparities must"),
        (["left.png", "right.png", "-o", "left.png"], "output must be a folder, got the file"),
        (["left.png", "right.png", "--backend", "odd"], "backend must be"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(
    command, pair, tmp_path, monkeypatch, words, rule
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_image("small.png", np.zeros((96, 127), np.uint8))
    before = names(tmp_path)
    code, out, err = command("stereo", "-o", "out", *words)
    assert (code, out) == (2, "")
    lines = [line for line in err.splitlines() if not line.startswith("Warp CUDA warning")]
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert rule in lines[0]
    assert names(tmp_path) == before


def test_nothing_to_see(command, tmp_path):
    """Of what matches nowhere, there is no cloud, and no file is left."""
    rng = np.random.default_rng(0)
    paths = [tmp_path / f"{name}.png" for name in ("left", "right")]
    for path in paths:
        write_image(path, rng.integers(0, 256, (4, 20), np.uint8))
    words = ["--focal", 1, "--baseline", 1, "--doffs", -100]  # behind the camera
    code, _, err = command("stereo", *paths, "-o", tmp_path / "out", "--max-disparity", 8, *words)
    assert code == 2
    assert "no pixel has a depth" in err
    assert not (tmp_path / "out").exists()


def test_results_are_replaced_only_when_asked(command, pair, tmp_path):
    words = "stereo", *pair, "-o", tmp_path / "out", "--max-disparity", 16
    assert command(*words)[0] == 0
    before = (tmp_path / "out" / "disparity.png").stat().st_mtime_ns
    code, _, err = command(*words)
    assert code == 2
    assert err.startswith("error: output must have no results yet, got ")
    assert err.rstrip().endswith("--overwrite replaces them")
    assert (tmp_path / "out" / "disparity.png").stat().st_mtime_ns == before
    assert command(*words, "--overwrite")[0] == 0
    assert (tmp_path / "out" / "disparity.png").stat().st_mtime_ns > before
