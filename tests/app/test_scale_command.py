"""``cvkern scale``, and folders in place of photographs: the results of functions, in files."""

import numpy as np
import pytest
import skimage.data
import tifffile

import cvkern
from cvkern.images import read_image, write_image

IMAGE = skimage.data.camera()[:120, :170]


@pytest.mark.parametrize("source", ["photo.png", "photo.npy", "photo.tif"])
@pytest.mark.parametrize("target", ["out.npy", "out.tif"])
def test_one_image(command, tmp_path, source, target):
    write_image(tmp_path / "photo.png", IMAGE)
    np.save(tmp_path / "photo.npy", IMAGE)
    tifffile.imwrite(tmp_path / "photo.tif", IMAGE)
    out = tmp_path / target
    words = ["scale", "canny", tmp_path / source, out, "sigma=2", "mode=nearest", "--tile", "64"]
    assert command(*words) == (0, f"{out}\n", "")
    got = np.load(out) if out.suffix == ".npy" else tifffile.imread(out) == 255
    np.testing.assert_array_equal(got, cvkern.canny(IMAGE, 2, mode="nearest"))
    assert sorted(p.name for p in tmp_path.iterdir() if p.name.startswith("out")) == [target]
    code, _, said = command(*words)
    assert code == 2
    assert "--overwrite replaces it" in said
    assert command(*words, "--overwrite")[0] == 0


def test_several_results(command, tmp_path):
    np.save(tmp_path / "photo.npy", IMAGE)
    code, said, _ = command("scale", "gradient", tmp_path / "photo.npy", tmp_path / "g.npy")
    assert code == 0
    want = cvkern.gradient(IMAGE)._asdict()
    assert said.split(", ")[0] == str(tmp_path / f"g.{next(iter(want))}.npy")
    for name, values in want.items():
        np.testing.assert_array_equal(np.load(tmp_path / f"g.{name}.npy"), values)


def test_a_folder(command, tmp_path):
    for name in ("a", "b"):
        write_image(tmp_path / f"{name}.png", IMAGE)
    (tmp_path / "c.png").write_bytes(b"no picture")
    out = tmp_path / "out"
    words = ["scale", "median", tmp_path, out, "radius=1", "--suffix", ".png"]
    code, said, errors = command(*words)
    assert (code, said) == (1, f"{out}: 2 written, 1 failed\n")
    assert "c.png: ValueError: path must be a readable image" in " ".join(errors.split())
    np.testing.assert_array_equal(read_image(out / "a.png"), cvkern.median(IMAGE, 1))
    (tmp_path / "c.png").unlink()
    assert command(*words)[1] == f"{out}: 0 written, 2 kept, 0 failed\n"


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ("function must be one of box, canny", ["sift", "photo.png", "out.npy"]),
        ("options must be of the form name=value", ["box", "photo.png", "out.npy", "3"]),
        ("options must be those of box", ["box", "photo.png", "out.npy", "size=3"]),
        ("target must end in .npy, .tif or .zarr", ["box", "photo.png", "out.png"]),
        ("source must be a file that exists", ["box", "none.npy", "out.npy"]),
        ("target must not be a file that is read", ["box", "photo.png", "photo.png"]),
    ],
)
def test_what_does_not_fit_is_refused(command, tmp_path, message, words):
    write_image(tmp_path / "photo.png", IMAGE)
    name, source, target, *options = words
    code, _, said = command("scale", name, tmp_path / source, tmp_path / target, *options)
    assert code == 2
    assert message in " ".join(said.split())
    assert not (tmp_path / "out.npy").exists()


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
