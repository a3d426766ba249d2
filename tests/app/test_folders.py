"""Folders in place of photographs: every file is done as it would be alone, and failures named."""

import numpy as np

import cvkern
from cvkern.images import read_image, write_image


def test_commands_take_folders(command, photo, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    image = read_image(photo)
    for name, one in (("a.png", image), ("c.tif", image[:, ::-1].copy())):
        write_image(folder / name, one)
    (folder / "b.jpg").write_bytes(b"no photograph")
    (folder / "notes.txt").write_text("no photograph either")
    code, said, errors = command(
        "edges", folder, "-o", tmp_path / "out", "--sigma", 2, "--subpixel", tmp_path / "points"
    )
    assert code == 1
    assert said.endswith("out: 2 written, 1 failed\n")
    assert errors.startswith(f"{folder / 'b.jpg'}: ")
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["a.png", "c.png"]
    assert sorted(file.name for file in (tmp_path / "points").iterdir()) == ["a.csv", "c.csv"]
    for name in ("a.png", "c.png"):
        source = folder / name.replace("c.png", "c.tif")
        want = cvkern.canny(
            read_image(source), 2, 0.7, 0.9, use_quantiles=True, operator="gaussian", mode="reflect"
        )
        assert np.array_equal(read_image(tmp_path / "out" / name) > 0, want)
    (folder / "b.jpg").unlink()
    shape = "find", photo, folder, "-o", tmp_path / "found", "--csv", tmp_path / "poses"
    assert command(*shape, "--rotations", 8, "--scales", 1, 1, 1)[0] == 0
    assert len(list((tmp_path / "poses").glob("*.csv"))) == 2


def test_folders_that_do_not_fit(command, photo, tmp_path):
    (tmp_path / "empty").mkdir()
    code, _, said = command("lines", tmp_path / "empty", "-o", tmp_path / "out")
    assert (code, "photo must be a folder with photographs" in said) == (2, True)
    write_image(tmp_path / "photo.jpg", read_image(photo))
    code, _, said = command("lines", tmp_path, "-o", tmp_path / "out")
    assert (code, "files of different names, got 'photo' twice" in said) == (2, True)
    (tmp_path / "photo.jpg").unlink()
    code, _, said = command("lines", tmp_path, "-o", tmp_path)
    assert (code, "output must be a folder of its own" in said) == (2, True)
