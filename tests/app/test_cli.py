"""The command line: what it writes, says and refuses."""

import csv
import inspect
import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import typer.main

import cvkern
from cvkern.app import cli, doctor, warmup
from cvkern.images import overlay_mask, read_image, write_image

# What the commands find edges with, unless told otherwise.
QUANTILES: Any = 0.7, 0.9, None, True
GAUSSIAN: dict[str, Any] = {"operator": "gaussian", "mode": "reflect"}


@pytest.fixture
def photo(tmp_path):
    """Write a grey picture of a disc over a ramp."""
    y, x = np.mgrid[:60, :70]
    image = (40 + x + 100 * (np.hypot(y - 31.3, x - 33.8) < 18)).astype(np.uint8)
    write_image(tmp_path / "photo.png", image)
    return tmp_path / "photo.png"


def test_version(command):
    assert command("--version") == (0, f"cvkern {cvkern.__version__}\n", "")


def test_help_names_every_command(command):
    code, out, _ = command("--help")
    assert code == 0
    assert all(name in out for name in ("doctor", "edges", "stereo", "tour", "warmup"))
    assert all(name in out for name in ("doctor", "edges", "nerf", "tour", "warmup"))


def test_edges(command, photo, tmp_path):
    code, out, _ = command("edges", photo, "-o", tmp_path / "edges.png", "--sigma", 2)
    assert code == 0
    mask = cvkern.canny(read_image(photo), 2.0, *QUANTILES, **GAUSSIAN)
    assert np.array_equal(read_image(tmp_path / "edges.png") > 0, mask)
    assert f"edges.png: {mask.sum()} edge pixels of 60 x 70" in out


def test_every_parameter_of_canny_is_an_option(command, photo, tmp_path):
    options = typer.main.get_command(cli.app).commands["edges"].params  # type: ignore[attr-defined]
    parameters = set(inspect.signature(cvkern.canny).parameters)
    assert parameters - {"image", "mask"} <= {p.name for p in options}
    defaults = inspect.signature(cvkern.canny).parameters
    for option in options:
        if option.name in set(defaults) - {"sigma", *GAUSSIAN}:  # these suit photographs better
            assert option.default == defaults[option.name].default
    given = {"sigma": 0.5, "low_threshold": 0.5, "high_threshold": 0.9, "operator": "scharr"}
    given |= {"norm": "l1", "mode": "constant", "cval": 7.0, "suppression": "sectors"}
    words = [w for k, v in given.items() for w in (f"--{k.replace('_', '-')}", v)]
    code, _, _ = command("edges", photo, "-o", tmp_path / "e.png", *words, "--use-quantiles")
    assert code == 0
    mask = cvkern.canny(read_image(photo), **given, use_quantiles=True)
    assert np.array_equal(read_image(tmp_path / "e.png") > 0, mask)


def test_edges_of_colour_alpha_and_deep_images(command, tmp_path):
    rng = np.random.default_rng(0)
    for image in (
        rng.integers(0, 256, (30, 40, 4), dtype=np.uint8),
        rng.integers(0, 65536, (30, 40, 3), dtype=np.uint16),
        rng.random((30, 40, 3), dtype=np.float32),
    ):
        path = tmp_path / "photo.tif"
        write_image(path, image)
        assert command("edges", path, "-o", tmp_path / "e.png", "--overlay")[0] == 0
        assert read_image(tmp_path / "e.png").shape == (30, 40, 3)


def test_overlay_and_subpixel(command, photo, tmp_path):
    table = tmp_path / "edges.csv"
    code, out, _ = command(
        "edges", photo, "-o", tmp_path / "e.png", "--overlay", "--subpixel", table, "--sigma", 1.5
    )
    assert code == 0
    image = read_image(photo)
    expected = overlay_mask(image, cvkern.canny(image, 1.5, *QUANTILES, **GAUSSIAN))
    assert np.array_equal(read_image(tmp_path / "e.png"), expected)
    found = cvkern.subpixel_edges(image, 1.5, 0.7, 0.9, use_quantiles=True)
    assert f"edges.csv: {len(found.points)} sub-pixel edges" in out
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["row", "column", "orientation", "strength"]
    read = np.array([[np.float32(value) for value in row.values()] for row in rows])
    assert np.array_equal(read, np.column_stack((found.points, found.orientation, found.strength)))


def test_subpixel_of_a_flat_image(command, tmp_path):
    write_image(tmp_path / "flat.png", np.full((9, 9), 7, np.uint8))
    table = tmp_path / "e.csv"
    code, out, _ = command(
        "edges", tmp_path / "flat.png", "-o", tmp_path / "e.png", "--subpixel", table
    )
    assert code == 0
    assert "e.csv: 0 sub-pixel edges" in out
    assert table.read_text() == "row,column,orientation,strength\n"


def test_find(command, photo, tmp_path):
    image = read_image(photo)
    write_image(tmp_path / "shape.png", image[8:56, 10:60])
    table, poses = tmp_path / "found.csv", tmp_path / "found.json"
    words = "find", tmp_path / "shape.png", photo, "-o", tmp_path / "f.png"
    options = "--rotations", 4, "--scales", 0.9, 1.1, 0.1
    code, out, _ = command(*words, *options, "--csv", table, "--json", poses)
    assert code == 0
    found = cvkern.find_shape(image[8:56, 10:60], image, rotations=4, scales=[0.9, 1.0, 1.1])
    assert "f.png: found 1 of shape.png\n" in out
    ((row, column),) = found.position
    assert abs(row - 31.5) < 0.1
    assert abs(column - 34.5) < 0.1
    assert f"row {row:.1f}, column {column:.1f}, rotation " in out
    (read,) = json.loads(poses.read_text())
    with table.open(newline="") as stream:
        (line,) = csv.DictReader(stream)
    assert list(line) == list(read) == ["row", "column", "rotation", "scale", "votes", "support"]
    want = (row, column, np.degrees(found.rotation[0]), found.scale[0], found.votes[0])
    for given in (line, read):
        values = [float(value) for value in given.values()]
        np.testing.assert_allclose(values, [*want, found.support[0]], rtol=1e-6, atol=1e-6)
    drawn = read_image(tmp_path / "f.png").astype(int)
    outline = (drawn == (255, 98, 41)).all(axis=2)  # its discs are a pixel in radius
    edges = cvkern.canny(image, 1.0, *QUANTILES, **GAUSSIAN)
    assert outline[edges].mean() > 0.9


def test_find_nothing(command, photo, tmp_path):
    write_image(tmp_path / "flat.png", np.full((40, 50), 7, np.uint8))
    table, poses = tmp_path / "found.csv", tmp_path / "found.json"
    code, out, _ = command(
        "find", photo, tmp_path / "flat.png", "-o", tmp_path / "f.png",
        "--csv", table, "--json", poses,
    )  # fmt: skip
    assert code == 0
    assert "found 0 of photo.png" in out
    assert table.read_text() == "row,column,rotation,scale,votes,support\n"
    assert json.loads(poses.read_text()) == []
    assert np.array_equal(read_image(tmp_path / "f.png"), read_image(tmp_path / "flat.png"))


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (
            ["--scales", "2", "1", "0.1"],
            "scales must be LOW <= HIGH and a STEP, all > 0, got 2 1 0.1",
        ),
        (["--scales", "1", "2", "0"], "scales must be LOW <= HIGH and a STEP, all > 0, got 1 2 0"),
        (["--rotations", "0"], "rotations must be in [1, 16384], got 0"),
        (["--csv", "photo.png"], "output must be a file of its own, got"),
    ],
)
def test_mistakes_of_find_write_nothing(command, photo, tmp_path, monkeypatch, words, rule):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, _, err = command("find", "photo.png", "photo.png", "-o", "f.png", *words)
    assert code == 2
    assert err.startswith(f"error: {rule}") or "of its own" in err
    assert sorted(tmp_path.iterdir()) == before


def test_the_other_kernel_set(command, photo, tmp_path):
    code, _, _ = command("edges", photo, "-o", tmp_path / "e.png", "--backend", "taichi")
    assert code == 0
    assert np.array_equal(
        read_image(tmp_path / "e.png") > 0,
        cvkern.canny(read_image(photo), 1.5, *QUANTILES, **GAUSSIAN),
    )


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["none.png", "-o", "e.png"], "path must be a file that exists, got 'none.png'"),
        (["broken.png", "-o", "e.png"], "path must be a readable image, got 'broken.png'"),
        (["photo.png", "-o", "e.xyz"], "path must end in one of"),
        (["photo.png", "-o", "none/e.png"], "folder that exists"),
        (["photo.png", "-o", "photo.png"], "output must be a file of its own"),
        (["photo.png", "-o", "e.png", "--subpixel", "e.png"], "output must be a file of its own"),
        (["photo.png", "-o", "e.png", "--sigma", "-1"], "sigma must be"),
        (["photo.png", "-o", "e.png", "--mode", "odd"], "mode must be"),
        (["photo.png", "-o", "e.png", "--norm", "l3"], "norm must be"),
        (["photo.png", "-o", "e.png", "--operator", "odd"], "operator must be"),
        (["photo.png", "-o", "e.png", "--low-threshold", "9", "--high-threshold", "3"], "must be"),
        (["photo.png", "-o", "e.png", "--backend", "odd"], "backend must be"),
        (["photo.png", "-o", "e.png", "--device", "odd"], "device must be"),
        (["photo.png", "-o", "e.xyz", "--subpixel", "e.csv"], "path must end in one of"),
        (["photo.png", "-o", "e.png", "--subpixel", "none/e.csv"], "folder that exists"),
        (["photo.png", "-o", "e.png", "--subpixel", "e.csv", "--norm", "l1"], "subpixel must"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(
    command, photo, tmp_path, monkeypatch, words, rule
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    code, out, err = command("edges", *words)
    assert code == 2
    assert out == ""
    lines = [line for line in err.splitlines() if not line.startswith("Warp CUDA warning")]
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert rule in lines[0]
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_wrong_usage(command):
    code, _, err = command("edges")
    assert code == 2
    assert "PHOTO" in err


def test_tour(command, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "cvkern.app.tour.tour", lambda folder, progress: asked.append(folder) or folder
    )
    monkeypatch.chdir(tmp_path)
    assert command("tour")[0] == 0
    assert command("tour", tmp_path / "mine")[:2] == (
        0,
        f"{tmp_path / 'mine'}: open it in a browser\n",
    )
    assert [str(folder) for folder in asked] == ["cvkern-tour", str(tmp_path / "mine")]


def test_warmup_calls_everything():
    alone = {
        "calibrate_camera", "calibrate_projector", "calibrate_stereo", "capture",
        "chessboard_points", "devices", "epipolar_lines", "epipoles", "essential_from_fundamental",
        "fit_affine", "fit_fundamental", "fit_homography", "fit_laser_plane", "fit_similarity",
        "project_points", "read_calibration", "recover_pose", "rectify_stereo", "release_memory",
        "reprojection_matrix", "sampson_distance", "triangulate", "triangulate_lines",
        "undistort_points", "write_calibration",
    }  # fmt: skip
    functions = {n for n in cvkern.__all__ if inspect.isfunction(getattr(cvkern, n))} - alone
    called = {name for name, _ in warmup.calls()}
    others = {
        "composite_rays", "composite_rays_backward", "fit", "make_scene", "positional_encoding",
        "spherical_harmonics", "turntable",
    }  # fmt: skip
    assert called == functions | others


def test_warmup(command, monkeypatch):
    called = []
    names = ("one", "two")
    calls = [(name, lambda name=name: called.append(name)) for name in names]
    monkeypatch.setattr(warmup, "calls", lambda: iter(calls))
    code, out, _ = command("warmup")
    assert (code, out) == (0, "All kernels are compiled.\n")
    assert called == ["one", "two"]


@pytest.mark.parametrize("kernels", ["warp", "taichi"])
def test_warmup_calls_work(kernels):
    with cvkern.use(backend=kernels):
        for _, call in warmup.calls():
            call()


def test_doctor(command):
    code, out, _ = command("doctor")
    assert code == 0, out
    assert cvkern.__version__ in out
    assert out.count("right") >= 4
    assert "Kernel cache of warp" in out
    assert "Kernel cache of taichi" in out


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ({"wrong": {"gaussian": "", "canny": "3 of 9 pixels are wrong"}}, 1),
        ({"wrong": {"process": "no answer within 600 s"}}, 1),
        ({"absent": "device must be one that is there"}, 0),
        ({"wrong": {"gaussian": "", "canny": ""}}, 0),
    ],
)
def test_doctor_tells_what_is_wrong(command, monkeypatch, fault, code):
    healthy = {"gaussian": "", "canny": ""}

    def examine(backend, device):
        sick = device == "cuda" if "absent" in fault else backend == "taichi"
        finding = doctor.Finding(backend, device)
        finding.absent = fault.get("absent", "") if sick else ""
        finding.wrong = fault.get("wrong", {}) if sick else healthy
        return finding

    monkeypatch.setattr(doctor, "examine", examine)
    found, out, _ = command("doctor")
    assert found == code
    for said in (fault.get("absent"), *fault.get("wrong", {}).values()):
        assert (said or "") in out


def test_doctor_sees_wrong_answers(monkeypatch):
    assert doctor.gaussian() == ""
    assert doctor.canny() == ""
    right = cvkern.gaussian
    monkeypatch.setattr(cvkern, "gaussian", lambda *a, **k: right(*a, **k) + np.float32(1e-3))
    assert "differs from SciPy by 0.001" in doctor.gaussian()
    mask = cvkern.canny
    monkeypatch.setattr(cvkern, "canny", lambda *a, **k: ~mask(*a, **k))
    assert "pixels are wrong" in doctor.canny()


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("import os; os.abort()", "ended with code"),
        ("import sys; sys.exit('the driver is broken')", "the driver is broken"),
        ("print('not JSON')", "ended with code 0"),
        ("import time; time.sleep(60)", "no answer within 1 s"),
    ],
)
def test_doctor_survives_the_patient(monkeypatch, program, said):
    run = subprocess.run
    monkeypatch.setattr(
        subprocess, "run", lambda command, **options: run([command[0], "-c", program], **options)
    )
    finding = doctor.examine("warp", "cpu", timeout=1)
    assert not finding.healthy
    assert said in finding.wrong["process"]


def test_the_command_starts_fast():
    heavy = ("warp", "taichi", "scipy", "imageio", "tifffile", "skimage", "rich")
    code = f"import sys, cvkern.app.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_circles(command, photo, tmp_path):
    files = {"csv": tmp_path / "circles.csv", "json": tmp_path / "circles.json"}
    code, out, _ = command(
        "circles", photo, "-o", tmp_path / "drawn.png", "--radius", 10, 30,
        "--csv", files["csv"], "--json", files["json"],
    )  # fmt: skip
    assert code == 0
    found = cvkern.detect_circles(read_image(photo), (10, 30))
    (row,) = json.loads(files["json"].read_text())
    want = (*found.centers[0].tolist(), *found.radii.tolist(), *found.support.tolist())
    assert tuple(row.values()) == want
    assert want[:3] == pytest.approx((31.3, 33.8, 18), abs=0.2)
    with files["csv"].open() as lines:
        (line,) = csv.DictReader(lines)
    assert list(line) == list(row) == ["row", "column", "radius", "support"]
    np.testing.assert_allclose([float(v) for v in line.values()], want, rtol=1e-6)
    assert "drawn.png: 1 circles\nrow 31.3" in out
    drawn = read_image(tmp_path / "drawn.png")
    assert drawn.shape == (60, 70, 3)
    assert (drawn[31, 51] != drawn[31, 51, 0]).any()  # on the circle, the colour


def test_circles_refused_leave_nothing(command, photo, tmp_path):
    out = tmp_path / "drawn.png"
    assert command("circles", photo, "-o", photo, "--radius", 10, 30)[0] == 2
    code, _, said = command("circles", photo, "-o", out, "--radius", 30, 10)
    assert code == 2
    assert "radius_range must rise, got 30 to 10" in said
    code, _, _ = command(
        "circles", photo, "-o", tmp_path / "a" / "drawn.png", "--radius", 10, 30,
        "--csv", tmp_path / "a.csv",
    )  # fmt: skip
    assert code == 2
    assert sorted(f.name for f in tmp_path.iterdir()) == ["photo.png"]


@pytest.mark.parametrize("whole", [False, True])
def test_lines(command, tmp_path, whole):
    step = np.full((60, 80), 40, np.uint8)
    step[:, 31:] = 190
    photo = tmp_path / "step.png"
    write_image(photo, step)
    files = {"csv": tmp_path / "lines.csv", "json": tmp_path / "lines.json"}
    code, out, _ = command(
        "lines", photo, "-o", tmp_path / "drawn.png", *(["--lines"] if whole else []),
        "--csv", files["csv"], "--json", files["json"],
    )  # fmt: skip
    assert code == 0
    (row,) = json.loads(files["json"].read_text())
    if whole:
        assert list(row) == ["theta", "rho", "votes"]
        assert list(row.values()) == pytest.approx([0, 30.5, 60], abs=0.05)
    else:
        assert list(row) == ["row", "column", "to_row", "to_column"]
        assert list(row.values()) == pytest.approx([0, 30.5, 59, 30.5], abs=0.05)
    with files["csv"].open() as lines:
        (line,) = csv.DictReader(lines)
    np.testing.assert_allclose([float(v) for v in line.values()], [*row.values()], rtol=1e-6)
    assert f"drawn.png: 1 {'lines' if whole else 'segments'}" in out
    coloured = np.ptp(read_image(tmp_path / "drawn.png").astype(int), axis=2) > 50
    assert coloured[1:-1, 30:32].all()
    assert not coloured[:, :28].any()
    assert not coloured[:, 34:].any()


def test_lines_refused_leave_nothing(command, photo, tmp_path):
    assert command("lines", photo, "-o", photo)[0] == 2
    code, _, said = command("lines", photo, "-o", tmp_path / "drawn.png", "--min-length", 0)
    assert code == 2
    assert "min_length must be > 0, got 0" in said
    assert sorted(f.name for f in tmp_path.iterdir()) == ["photo.png"]


def test_a_tour_is_replaced_only_when_asked(command, tmp_path):
    (tmp_path / "index.html").write_text("here already")
    code, _, err = command("tour", tmp_path)
    assert code == 2
    assert "folder must have no tour yet" in err
    assert (tmp_path / "index.html").read_text() == "here already"


@pytest.mark.filterwarnings("default:no edge was found")
def test_warnings_are_one_line(photo, tmp_path):
    """In a process of its own: warnings of this one belong to pytest."""
    words = [sys.executable, "-m", "cvkern.app.cli", "edges", str(photo), "-o", tmp_path / "e.png"]
    words += ["--low-threshold", "90000", "--high-threshold", "90000"]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=True)
    assert "0 edge pixels of 60 x 70" in done.stdout
    assert done.stderr.startswith("warning: no edge was found: the longest gradient of the image")
    assert done.stderr.count("\n") == 1


def test_every_operator_of_the_help_is_one(command, photo, tmp_path):
    for operator in ("gaussian", "sobel", "scharr"):
        assert command("edges", photo, "-o", tmp_path / "e.png", "--operator", operator)[0] == 0
        assert read_image(tmp_path / "e.png").any()


def test_twelve_bits_in_sixteen_are_seen(command, photo, tmp_path):
    """The thresholds come from the image, not from what its dtype could hold."""
    deep = read_image(photo).astype(np.uint16) * 16
    write_image(tmp_path / "deep.png", deep)
    code, _, _ = command("edges", tmp_path / "deep.png", "-o", tmp_path / "e.png")
    assert code == 0
    command("edges", photo, "-o", tmp_path / "same.png")
    assert np.array_equal(read_image(tmp_path / "e.png"), read_image(tmp_path / "same.png"))
    assert len(cvkern.detect_circles(deep, (10, 30)).radii) == 1
    assert len(cvkern.detect_segments(deep))
