"""The command line: what it writes, says and refuses."""

import csv
import inspect
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import typer.main

import cvkern
from cvkern.app import cli
from cvkern.images import overlay_mask, read_image, write_image

# What the commands find edges with, unless told otherwise.
QUANTILES: Any = 0.7, 0.9, None, True
GAUSSIAN: dict[str, Any] = {"operator": "gaussian", "mode": "reflect"}


def test_version(command):
    assert command("--version") == (0, f"cvkern {cvkern.__version__}\n", "")


def test_help_names_every_command(command):
    code, out, _ = command("--help")
    assert code == 0
    for name in typer.main.get_command(cli.app).commands:  # type: ignore[attr-defined]
        assert re.search(rf"^. {name} ", out, re.MULTILINE), name


def test_edges(command, photo, tmp_path):
    code, out, _ = command("edges", photo, "-o", tmp_path / "edges.png", "--sigma", 2)
    assert code == 0
    mask = cvkern.canny(read_image(photo), 2.0, *QUANTILES, **GAUSSIAN)
    assert np.array_equal(read_image(tmp_path / "edges.png") > 0, mask)
    assert f"edges.png: {mask.sum()} edge pixels of 60 x 70" in out


def test_every_parameter_of_canny_is_an_option(command, photo, tmp_path):
    options = typer.main.get_command(cli.app).commands["edges"].params  # type: ignore[attr-defined]
    parameters = set(inspect.signature(cvkern.canny).parameters)
    assert parameters - {"image", "mask", "batch_axis"} <= {p.name for p in options}
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
        (["photo.png", "-o", "photo.png"], "output must not be a file that is read"),
        (["photo.png", "-o", "e.png", "--subpixel", "e.png"], "subpixel must not be a file"),
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
