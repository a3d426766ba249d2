"""``cvkern view``: pages that a browser shows, and that follow their controls."""

import subprocess
import sys
import time

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.app.commands import view
from cvkern.clouds import write_ply
from cvkern.radiance import SplatField, VoxelField, fit, make_scene, write_splats
from tests.app.browser import PATIENCE, opened

pytest.importorskip("viser")
from cvkern.app.viewer.clouds import cloud_page
from cvkern.app.viewer.fields import FieldPage
from cvkern.app.viewer.photographs import PhotographPage, fitted, map_page
from cvkern.app.viewer.server import Page


def test_a_photograph_follows_its_sliders(tmp_path):
    image = skimage.data.coffee()[::2, ::2]
    page = PhotographPage(image)
    page.serve()
    with opened(page.page.address, tmp_path) as tab:

        def red(seen):
            """Count the pixels of marks, left of the controls and below what the browser says."""
            part = seen[160:400, :500].astype(int)
            return int(((part[..., 0] > 240) & (abs(part[..., 1:] - 64) < 12).all(axis=-1)).sum())

        many = red(tab.until(lambda seen: red(seen) > 300))
        page.controls["sigma"].value = 6.0
        page.serve()
        assert red(tab.until(lambda seen: red(seen) < many / 2)) > 0
        page.controls["kind"].value = "photograph"
        page.serve()
        tab.until(lambda seen: red(seen) < 20)
        assert not tab.errors
    sigma, edges = 6.0, cvkern.canny(image, 6.0, 0.7, 0.9, use_quantiles=True, operator="gaussian")
    assert (page.state["sigma"], page.state["kind"]) == (sigma, "photograph")
    page.controls["kind"].value = "edges"
    page.serve()
    assert page.text.content.startswith(f"edge pixels: {int(edges.sum()):,}")
    page.page.close()


def test_a_field_is_drawn_while_it_trains(tmp_path):
    scene = make_scene(train=4, test=1, size=24)
    page = FieldPage(scene.cameras)
    with opened(page.page.address, tmp_path) as tab:
        end = time.monotonic() + PATIENCE
        while not page.moved:
            assert time.monotonic() < end
            time.sleep(0.05)
        texts = []

        def look(step, loss, model):
            page.serve(model, f"Step {step}")
            texts.append((page.text.content, [s[2] for s in page.shown.values()]))

        small = VoxelField(resolutions=(16,), shares=())
        fit(scene, small, steps=32, callback=look, progress=False)
        assert texts[0] == ("Step 16", [16])
        assert texts[-1][1] == [32]
        tab.until(lambda seen: seen[160:400, :500].std() > 30)
        assert not tab.errors
    page.page.close()


def test_a_cloud_and_a_map(tmp_path):
    points = np.random.default_rng(0).normal((0, 0, 6), (2, 1, 0.5), (500, 3))
    page = cloud_page(points, np.zeros((500, 3), np.uint8))
    with opened(page.address, tmp_path / "a") as tab:
        tab.until(lambda seen: (seen[160:400, :500] < 60).all(axis=-1).sum() > 100)
        assert not tab.errors
    page.close()
    values = np.arange(20 * 30, dtype=np.float32).reshape(20, 30)
    page = map_page(values, depth=10 * values)
    with opened(page.address, tmp_path / "b") as tab:
        tab.until(lambda seen: seen[200:300, 100:400].std() > 30)
        for kind in ("mousePressed", "mouseReleased"):
            tab.call(
                "Input.dispatchMouseEvent", type=kind, x=289, y=229, button="left", clickCount=1
            )
        said = "document.body.innerText"
        end = time.monotonic() + PATIENCE
        while (
            "row 10, column 15: 315, depth 3150"
            not in tab.call("Runtime.evaluate", expression=said)["result"]["value"]
        ):
            assert time.monotonic() < end
            time.sleep(0.1)
    page.close()


def test_bars_keep_the_aspect():
    image = np.ones((20, 30, 3), np.uint8)
    assert fitted(image, 1.0).shape == (30, 30, 3)
    assert fitted(image, 3.0).shape == (20, 60, 3)
    assert fitted(image, 3.0).sum() == image.sum()


@pytest.mark.parametrize("kind", ["photo", "cloud", "map", "splats"])
def test_the_command(command, photo, tmp_path, monkeypatch, kind):
    """It listens on this machine only, and reads a picture once."""
    if kind == "splats":
        scene = make_scene(train=2, test=0, size=12)
        made = fit(scene, SplatField(splats=9, start="random"), steps=1, progress=False)
        write_splats(tmp_path / "splats.ply", made)
    write_ply(tmp_path / "cloud.ply", np.eye(3))
    np.save(tmp_path / "map.npy", np.eye(5))
    names = {"cloud": "cloud.ply", "map": "map.npy", "splats": "splats.ply"}
    file = photo if kind == "photo" else tmp_path / names[kind]
    monkeypatch.setattr(Page, "wait", lambda page, serve: (serve(), page.close()))
    given = ("--focal", 900, "--baseline", 0.1) if kind == "map" else ()
    read, values = [], view._values
    monkeypatch.setattr(view, "_values", lambda file: read.append(file) or values(file))
    code, said, _ = command("view", file, "--port", 8650, *given)
    assert code == 0
    assert read == ([file] if kind in ("photo", "map") else [])
    assert said == "http://127.0.0.1:8650: open it in a browser; Ctrl-C ends\n"


def test_recordings(command, photo, tmp_path):
    """Their tables hold what was seen; the reader is rerun's own."""
    pytest.importorskip("rerun")
    write_ply(tmp_path / "cloud.ply", np.eye(3))
    np.save(tmp_path / "map.npy", np.eye(5))
    small = VoxelField(resolutions=(16,), shares=())
    fit(make_scene(train=3, test=1, size=16), small, steps=2, progress=False,
        checkpoint=tmp_path / "field.npz")  # fmt: skip
    seen = {
        photo: ("/photograph", "/photograph/edges"),
        tmp_path / "map.npy": ("/map",),
        tmp_path / "cloud.ply": ("/cloud/points",),
        tmp_path / "field.npz": ("/field/camera", "/field/camera/picture"),
    }
    for file, entities in seen.items():
        target = tmp_path / f"{file.stem}.rrd"
        assert command("view", file, "--record", target)[0] == 0
        read = [sys.executable, "-m", "rerun", "rrd", "print", target]
        found = subprocess.run(read, capture_output=True, text=True, check=True).stdout
        assert all(entity in found for entity in entities)
    code, _, said = command("view", photo, "--record", tmp_path / "cloud.rrd")
    assert (code, "--overwrite" in said) == (2, True)
    assert command("view", photo, "--record", tmp_path / "a.txt")[0] == 2


def test_files_that_are_none(command, tmp_path):
    (tmp_path / "a.npz").write_bytes(b"no model")
    np.save(tmp_path / "map.npy", np.eye(5))
    np.save(tmp_path / "photo.npy", np.eye(5, dtype=np.uint8))
    for file, words, message in (
        ("map.npy", (), "focal must be given with baseline"),
        ("photo.npy", ("--baseline", 1), "focal must go with a map of disparities"),
    ):
        code, _, said = command("view", tmp_path / file, "--focal", 900, *words)
        assert (code, message in " ".join(said.split())) == (2, True)
    (tmp_path / "empty.npy").touch()
    for file, message in (
        ("none.png", "file must be one that exists"), ("a.npz", "a.npz"),
        ("empty.npy", "file must be an array of NumPy"),
    ):  # fmt: skip
        code, _, said = command("view", tmp_path / file)
        assert code == 2
        assert message in " ".join(said.split())
