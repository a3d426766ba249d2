"""``cvkern nerf``: from a folder of photographs to pictures, figures and a mesh."""

import json
import math
import os
import signal
import sys
from dataclasses import asdict

import numpy as np
import pytest

import cvkern
from cvkern.app import cli
from cvkern.app.commands._scenes import within
from cvkern.images import read_image, write_image
from cvkern.radiance import (
    VoxelField,
    evaluate,
    fit,
    load_model,
    load_scene,
    make_scene,
    orbit_cameras,
    render,
    training,
)
from cvkern.radiance.fields.voxel import VoxelGrid
from cvkern.radiance.trainer import Trainer
from tests.radiance.runs import same

SIZE = 20
SMALL = VoxelField(resolutions=(16, 32), shares=(0.3,), rays=256)


@pytest.fixture
def command(monkeypatch, capsys):
    """Return a function that runs the command and gives exit code, output and errors."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["cvkern", "nerf", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code or 0, said.out, said.err

    return run


@pytest.fixture(scope="module", autouse=True)
def small_fields():
    """Train small fields where the command is not told which."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(training.ON_CPU, "voxel", asdict(SMALL))
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write a small scene in Blender's format."""
    made, root = make_scene(train=8, test=2, size=SIZE), tmp_path_factory.mktemp("scene")
    angle = 2 * math.atan(0.5 * SIZE / made.cameras.intrinsics[0, 0])
    for part, chosen in (("train", ~made.test), ("test", made.test)):
        (root / part).mkdir()
        frames = []
        for view in np.flatnonzero(chosen):
            write_image(root / part / f"r_{view}.png", made.images[view])
            pose = np.eye(4)
            pose[:3] = made.cameras.poses[view] * [1, -1, -1, 1]  # to OpenGL's axes
            frame = {"file_path": f"./{part}/r_{view}", "transform_matrix": pose.tolist()}
            frames.append(frame)
        text = json.dumps({"camera_angle_x": angle, "frames": frames})
        (root / f"transforms_{part}.json").write_text(text)
    return root


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    """Return a model that the command made."""
    file = tmp_path_factory.mktemp("model") / "model.npz"
    with pytest.MonkeyPatch.context() as patch:
        words = ["cvkern", "nerf", "train", str(folder), "-o", str(file), "--steps", "40"]
        patch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as stop:
            cli.main()
    assert not stop.value.code
    return file


def test_train(command, folder, tmp_path):
    file = tmp_path / "model.npz"
    code, out, err = command("train", folder, "-o", file, "--steps", 20, "--seed", 3)
    assert (code, err) == (0, "")
    model = load_model(file)
    assert (model.training.step, model.seed, model.settings) == (20, 3, SMALL)
    last = model.training.marks[-1]
    rate = model.training.total_rays / model.training.seconds
    assert out == (
        f"{file}: 20 steps in {model.training.seconds:.1f} s, {rate:,.0f} rays/s, held-out views "
        f"{last.test_psnr:.2f} dB, SSIM {last.test_ssim:.3f}\n"
    )
    code, out, _ = command(
        "train", folder, "-o", file, "--steps", 25, "--seed", 3, "--resume"
    )  # fmt: skip
    assert code == 0
    assert load_model(file).training.step == 25


def test_options_of_train(command, folder, tmp_path, monkeypatch):
    file = tmp_path / "model.npz"
    asked = []
    monkeypatch.setattr(VoxelGrid, "make_deterministic", lambda self: asked.append(self))
    words = ["--field", "voxel", "--background", "learnt", "--loss", "huber", "--shrink", 2]
    words += ["--deterministic", "--backend", "taichi"]
    code, _, _ = command("train", folder, "-o", file, "--steps", 2, *words)
    assert code == 0
    assert len(asked) == 1
    options = {"steps": 2, "background": "learnt"}
    with cvkern.use(backend="taichi"):
        small = load_scene(folder).resized(2)
        squared, huber = (fit(small, SMALL, loss=loss, **options) for loss in ("squared", "huber"))
        made = load_model(file)
        assert same(made, huber)
        assert not same(made, squared)
    assert made.background == "learnt"
    code, _, _ = command("train", folder, "-o", file, "--seconds", 0.05, "--overwrite")
    assert code == 0
    assert load_model(file).training.seconds >= 0.05


def test_ctrl_c_writes_the_model(command, folder, tmp_path, monkeypatch):
    repeat = Trainer.repeat

    def interrupted(self):
        repeat(self)
        if self.model.training.step == 4:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Trainer, "repeat", interrupted)
    code, out, _ = command("train", folder, "-o", tmp_path / "m.npz", "--steps", 50)
    assert code == 0
    assert "m.npz: 5 steps in" in out
    assert out.endswith("s, stopped\n")
    assert load_model(tmp_path / "m.npz").training.step == 5


def test_render(command, trained, tmp_path):
    picture, depth = tmp_path / "view.png", tmp_path / "depth.png"
    code, out, _ = command("render", trained, "-o", picture, "--view", 3, "--depth", depth)
    assert (code, out) == (0, f"{picture}: 20 x 20\n")
    model = load_model(trained)
    want = render(model, model.cameras, 3)
    np.testing.assert_array_equal(read_image(picture), np.round(255 * want.color))
    shown = read_image(depth).sum(axis=2, dtype=int)
    assert shown.flat[np.nanargmin(want.depth)] > shown.flat[np.nanargmax(want.depth)] > 0
    assert (shown[np.isnan(want.depth)] == 0).all()
    code, out, _ = command("render", trained, "-o", picture, "--size", 1.5)
    assert (code, out) == (0, f"{picture}: 30 x 30\n")


def test_render_an_orbit(command, trained, tmp_path):
    import imageio.v3 as iio

    film = tmp_path / "orbit.gif"
    words = ["--orbit", "--frames", 4, "--size", 2]
    code, out, _ = command("render", trained, "-o", film, *words)
    assert (code, out) == (0, f"{film}: 4 frames of 40 x 40\n")
    frames = iio.imread(film)
    model = load_model(trained)
    want = render(model, orbit_cameras(model.cameras, 4, factor=2), 1).color
    # A GIF has 256 colours a frame.
    assert np.abs(frames[1] / 255 - want).mean() < 0.03


def test_render_raw_depth(command, trained, tmp_path):
    depth = tmp_path / "depth.npy"
    assert command("render", trained, "-o", tmp_path / "v.png", "--depth", depth)[0] == 0
    model = load_model(trained)
    found = np.load(depth, allow_pickle=False)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, render(model, model.cameras, 0).depth)


def test_render_a_camera_path(command, trained, folder, tmp_path):
    import imageio.v3 as iio

    film = tmp_path / "film.gif"
    words = ["--path", folder / "transforms_test.json", "--size", 0.5]
    code, out, _ = command("render", trained, "-o", film, *words)
    assert (code, out) == (0, f"{film}: 2 frames of 10 x 10\n")
    model, scene = load_model(trained), load_scene(folder)
    want = render(model, scene.cameras.scaled(0.5), int(np.flatnonzero(scene.test)[1])).color
    assert np.abs(iio.imread(film)[1] / 255 - want).mean() < 0.03


def test_log_of_train(command, folder, tmp_path):
    log = tmp_path / "log.csv"
    words = [folder, "-o", tmp_path / "m.npz", "--log", log]
    assert command("train", *words, "--steps", 20)[0] == 0
    assert command("train", *words, "--steps", 36, "--resume")[0] == 0
    steps = [line.split(",")[0] for line in log.read_text().splitlines()]
    assert steps == ["step", "16", "20", "32", "36"]


def test_eval(command, folder, trained):
    code, out, _ = command("eval", trained, folder)
    assert code == 0
    scene = load_scene(folder)
    scores = evaluate(load_model(trained), scene)
    lines = out.splitlines()
    assert len(lines) == 3
    view = np.flatnonzero(scene.test)[0]
    assert lines[0] == f"view {view}: {scores.psnr[0]:.2f} dB, SSIM {scores.ssim[0]:.3f}"
    assert lines[2] == (
        f"mean of 2: {scores.psnr.mean():.2f} dB, SSIM {scores.ssim.mean():.3f}"
    )  # fmt: skip


def test_export(command, trained, tmp_path):
    file = tmp_path / "mesh.ply"
    code, out, _ = command("export", trained, "-o", file, "--resolution", 24, "--density", 1)
    assert code == 0
    head = file.read_bytes().partition(b"end_header")[0].decode("ascii")
    count = int(head.partition("element face ")[2].split()[0])
    assert count > 100
    assert out == f"{file}: {count} triangles\n"


def test_export_of_a_smaller_model(command, trained, tmp_path):
    file = tmp_path / "small.npz"
    code, out, _ = command("export", trained, "-o", file)
    assert code == 0
    assert out == f"{file}: {file.stat().st_size / 2**20:.1f} MiB\n"
    assert file.stat().st_size < 0.25 * trained.stat().st_size


def test_export_points(command, trained, tmp_path):
    file = tmp_path / "points.ply"
    code, out, _ = command("export", trained, "-o", file, "--points")
    assert code == 0
    assert f"element vertex {out.split()[-2]}" in file.read_bytes()[:200].decode("ascii", "replace")


def test_the_synthetic_scene(command, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "cvkern.radiance.make_scene", lambda layout: make_scene(train=4, test=1, size=16)
    )
    monkeypatch.chdir(tmp_path)
    assert command("train", "shapes", "-o", "m.npz", "--steps", 1)[0] == 0
    assert len(load_model("m.npz").cameras) == 5


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["train", "none", "-o", "m.npz"], "path must be a folder of posed photographs, got"),
        (["train", "empty", "-o", "m.npz"], "path must hold transforms_train.json"),
        (["train", "SCENE", "-o", "m.txt"], "path must end in .npz, got 'm.txt'"),
        (["train", "SCENE", "-o", "none/m.npz"], "path must lie in a folder that exists"),
        (["train", "SCENE", "-o", "m.npz", "--seconds", "-2"], "seconds must be > 0, got -2"),
        (["train", "SCENE", "-o", "m.npz", "--background", "odd"], "background must be one of"),
        (["train", "SCENE", "-o", "m.npz", "--field", "odd"], "field must be one of"),
        (["train", "SCENE", "-o", "m.npz", "--shrink", "0"], "shrink must be in [1, 20], got 0"),
        (["train", "SCENE", "-o", "broken.npz", "--resume"], "path must be a whole model"),
        (["render", "none.npz", "-o", "p.png"], "path must be a file that exists"),
        (["render", "broken.npz", "-o", "p.png"], "path must be a whole model, got 'broken.npz'"),
        (["render", "MODEL", "-o", "p.png", "--view", "99"], "view must be in [0, 9], got 99"),
        (["render", "MODEL", "-o", "p.png", "--size", "0"], "size must be > 0, got 0"),
        (["render", "MODEL", "-o", "p.png", "--depth", "p.png"], "depth must not be a file"),
        (["render", "MODEL", "-o", "p.gif", "--orbit", "--depth", "d.png"], "depth must go with"),
        (["render", "MODEL", "-o", "p.xyz"], "path must end in one of"),
        (["eval", "MODEL", "none"], "path must be a folder of posed photographs"),
        (
            ["render", "MODEL", "-o", "o.gif", "--orbit", "--fps", "60"],
            "fps must be in [0.0016, 50] for",
        ),
        (
            ["render", "MODEL", "-o", "p.png", "--light-to", "1"],
            "light-to must go with a film",
        ),
        (
            ["render", "MODEL", "-o", "p.gif", "--orbit", "--light-to", "99"],
            "light-to must be in",
        ),
        (
            ["render", "MODEL", "-o", "p.gif", "--path", "p.json", "--orbit"],
            "path must not go with an orbit",
        ),
        (["render", "MODEL", "-o", "p.gif", "--path", "p.json"], "path must be a file that exists"),
        (["train", "SCENE", "-o", "m.npz", "--log", "log.txt"], "log must end in .csv, or be"),
        (
            ["export", "MODEL", "-o", "m.obj"],
            "output must end in .ply, .glb, .npz, .html or .png, got 'm.obj'",
        ),
        (["export", "MODEL", "-o", "m.glb", "--points"], "output must end in .ply for points"),
        (["export", "MODEL", "-o", "m.ply", "--density", "1e9"], "density must be below"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(
    command, folder, trained, tmp_path, monkeypatch, words, rule
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04nothing")
    before = sorted(tmp_path.iterdir())
    known = {"SCENE": folder, "MODEL": trained}
    code, out, err = command(*(known.get(word, word) for word in words))
    assert (code, out) == (2, "")
    lines = [line for line in err.splitlines() if not line.startswith("Warp CUDA warning")]
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert rule in lines[0]
    assert sorted(tmp_path.iterdir()) == before


def test_train_takes_bounds_and_settings(command, folder, tmp_path):
    output = tmp_path / "model.npz"
    options = ["--bounds", "0.1,0.2,0.3,2", "--near", "1", "--far", "7", "--steps", "1"]
    settings = ["--set", "resolutions=[16]", "--set", "shares=[]", "--set", "degree=1"]
    code, _, said = command("train", folder, "-o", output, *options, *settings)
    assert code == 0, said
    made = load_model(output)
    assert made.frame.bounds == ((0.1, 0.2, 0.3), 2.0, False)
    assert (made.frame.near, made.frame.far) == (0.5, 3.5)  # in halves of the side
    assert (made.settings.resolutions, made.settings.degree) == ((16,), 1)
    with pytest.warns(UserWarning, match="100% of the cameras look past the scene's cube"):
        within(load_scene(folder), "90,90,90,1", None, None)
    for wrong, rule in (
        (["--bounds", "1,2"], "bounds must be X,Y,Z,HALF, got '1,2'"),
        (["--set", "degree"], "set must be NAME=VALUE with a number, got 'degree'"),
        (["--set", "colour=1"], "set must be one of"),
        (["--set", "resolutions=32"], "shares must be 0 numbers, got 1"),
    ):
        code, _, said = command("train", folder, "-o", tmp_path / "b.npz", "--steps", 1, *wrong)
        assert code != 0
        assert rule in said


def test_planes_of_a_pair_and_of_a_model(command, tmp_path):
    rng = np.random.default_rng(0)
    wide = np.kron(rng.integers(0, 256, (12, 20, 3), np.uint8), np.ones((2, 2, 1), np.uint8))
    left, right, page = (tmp_path / name for name in ("left.png", "right.png", "page.html"))
    write_image(left, wide[:, :-4])
    write_image(right, wide[..., 0][:, 4:])  # a grey photograph is read too
    options = "--max-disparity", 8, "--count", 3
    code, said, _ = command("planes", left, right, "-o", page, *options)
    assert (code, said) == (0, f"{page}: 3 planes of 24 x 36\n")
    assert "WebGL" in page.read_text()
    model, atlas = tmp_path / "model.npz", tmp_path / "atlas.png"
    assert command("planes", left, right, "-o", model, *options)[0] == 0
    assert command("export", model, "-o", atlas)[0] == 0
    assert {f.suffix for f in tmp_path.iterdir()} >= {".html", ".png", ".npz", ".json"}
    code, _, error = command("planes", left, right, "-o", tmp_path / "planes.gif")
    assert code == 2
    assert "output must end in .html, .png or .npz" in error


def test_splats_are_trained_by_name(command, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "cvkern.radiance.make_scene",
        lambda layout: make_scene(train=4, test=1, size=24, layout=layout),
    )
    model, file = tmp_path / "model.npz", tmp_path / "splats.ply"
    words = "train", "shapes", "-o", model, "--field", "splats", "--steps", 2
    code, said, _ = command(
        *words, "--set", "splats=50", "--set", "degree=1", "--set", "start=random"
    )
    assert code == 0
    assert "held-out views" in said
    code, said, _ = command("export", model, "-o", file)
    assert (code, said) == (0, f"{file}: 50 splats\n")
    code, said, _ = command("export", model, "-o", tmp_path / "points.ply", "--points")
    assert (code, said.split()[-1]) == (0, "points")
    code, _, error = command("export", model, "-o", tmp_path / "mesh.glb")
    assert code != 0
    assert "model must have densities" in error


def test_planes_are_trained_by_name(command, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "cvkern.radiance.make_scene",
        lambda layout: make_scene(train=4, test=1, size=24, layout=layout),
    )
    model = tmp_path / "model.npz"
    words = "train", "shapes-forward", "-o", model, "--field", "planes", "--steps", 2
    code, said, _ = command(*words, "--set", "planes=3", "--set", "references=2")
    assert code == 0
    assert "held-out views" in said
    page = tmp_path / "page.html"
    assert command("export", model, "-o", page, "--reference", 1)[0] == 0
    code, _, error = command("export", model, "-o", page, "--reference", 2, "--overwrite")
    assert code == 2
    assert "reference must be in [0, 1], got 2" in error
