"""``cvkern recognize``: what it writes, says and refuses."""

import json

import numpy as np
import pytest

from cvkern.images import read_image, write_image
from tests.recognition.alphabet import clutter, overlap, put, thing, things


def as_bytes(image):
    return np.rint(255 * image).astype(np.uint8)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Make a folder to learn from, and a photograph to search."""
    folder = tmp_path_factory.mktemp("recognize")
    (folder / "all" / "negatives").mkdir(parents=True)
    (folder / "all" / "masks").mkdir()
    for number, picture in enumerate(things(3)):
        write_image(folder / "all" / f"{number}.png", as_bytes(picture))
        write_image(folder / "all" / "masks" / f"{number}.png", np.full((32, 48), 255, np.uint8))
    for seed in range(3):
        sheet = np.repeat(as_bytes(clutter((90, 130), seed))[..., None], 3, 2)
        write_image(folder / "all" / "negatives" / f"{seed}.png", sheet)
    photo = clutter((120, 160), 51)
    put(photo, thing(), 50, 70)
    write_image(folder / "photo.png", as_bytes(photo))
    return folder


def test_recognize(command, pictures, tmp_path):
    model, out = tmp_path / "model.npz", tmp_path / "out.png"
    options = "--words", "60", "--patch", "12", "--no-mirror"
    code, said, _ = command("recognize", "train", pictures / "all", "-o", model, *options)
    assert code == 0
    assert "learnt 3 objects against 3 negatives" in said
    code, said, _ = command(
        "recognize", model, pictures / "photo.png", "-o", out, "--scales", "1",
        "--csv", tmp_path / "out.csv", "--json", tmp_path / "out.json",
    )  # fmt: skip
    assert code == 0
    rows = json.loads((tmp_path / "out.json").read_text())
    assert overlap(rows[0]["box"], (50, 70, 82, 118)) > 0.7
    assert f"found {len(rows)}" in said
    table = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1, ndmin=2)
    np.testing.assert_allclose(table[0, :4], rows[0]["box"], rtol=1e-6)
    changed = (read_image(out) != read_image(pictures / "photo.png")[..., None]).any(axis=-1)
    assert changed[55:77, 75:113].mean() > 0.9  # the pixels of the object are tinted
    rows_drawn, columns_drawn = np.nonzero(changed)
    assert rows_drawn.min() <= 52
    assert columns_drawn.max() >= 116


def test_boxes_of_pictures(command, pictures, tmp_path):
    folder = tmp_path / "boxed"
    folder.mkdir()
    write_image(folder / "a.png", read_image(pictures / "photo.png"))
    (folder / "boxes.json").write_text(json.dumps({"a.png": [[50, 70, 82, 118]]}))
    code, said, _ = command("recognize", "train", folder, "-o", tmp_path / "m.npz", "--words", "30")
    assert (code, "learnt 1 objects against 0 negatives" in said) == (0, True)
    (folder / "boxes.json").write_text(json.dumps({"b.png": []}))
    code, _, error = command("recognize", "train", folder, "-o", tmp_path / "n.npz")
    assert (code, "boxes.json must have names of pictures" in error) == (2, True)


def test_refusals(command, pictures, tmp_path):
    (tmp_path / "old.npz").write_text("mine")
    photo = pictures / "photo.png"
    for arguments, said in [
        (("train", tmp_path / "none", "-o", "m.npz"), "folder must be a folder that exists"),
        (("train", tmp_path, "-o", tmp_path / "m.npz"), "folder must have pictures"),
        (("train", pictures / "all", "-o", tmp_path / "old.npz"), "output must be a new file"),
        ((tmp_path / "none.npz", photo, "-o", tmp_path / "o.png"), "path must be a file"),
        ((tmp_path / "old.npz", photo, "-o", tmp_path / "o.png"), "must be a model"),
        ((tmp_path / "old.npz", photo, "-o", photo), "output must not be a file that is read"),
        ((tmp_path / "old.npz", photo, "-o", "o.png", "--scales", "1,x"), "scales must be numbers"),
    ]:
        code, _, error = command("recognize", *arguments)
        assert (code, said in error) == (2, True), error
    assert (tmp_path / "old.npz").read_text() == "mine"
    assert not (tmp_path / "o.png").exists()
