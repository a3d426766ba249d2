"""``cvkern scale``: the results of the function, in files."""

import errno

import numpy as np
import pytest
import skimage.data
import tifffile

import cvkern
from cvkern.images import read_image, write_image
from cvkern.scale.sources import opened

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


def test_pieces_of_a_tiff_and_colours(command, tmp_path):
    """Only the pieces that a window touches are decoded; channels need no option."""
    color = skimage.data.astronaut()[:90, :131]
    kinds = {
        "tiles": {"tile": (32, 48)}, "strips": {"rowsperstrip": 17, "compression": "zlib"},
        "wide": {"tile": (16, 16), "compression": "zlib", "predictor": True, "byteorder": ">"},
    }  # fmt: skip
    want = cvkern.median(color, 2, channel_axis=-1)
    for name, kind in kinds.items():
        source, out = tmp_path / f"{name}.tif", tmp_path / f"{name}.npy"
        tifffile.imwrite(source, color, photometric="rgb", **kind)
        assert type(opened(source)).__name__ == "_Pieces"
        np.testing.assert_array_equal(opened(source)[33:70, 47:97], color[33:70, 47:97])
        assert command("scale", "median", source, out, "radius=2", "--tile", 40)[0] == 0
        np.testing.assert_array_equal(np.load(out), want)
    tifffile.imwrite(tmp_path / "planes.tif", np.moveaxis(color, 2, 0), photometric="rgb",
                     planarconfig="separate")  # fmt: skip
    np.testing.assert_array_equal(opened(tmp_path / "planes.tif"), color)


def test_a_full_disk(command, tmp_path, monkeypatch):
    """The kernel's signal would end the process in the middle of a tile."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full, raising=False)
    write_image(tmp_path / "photo.png", IMAGE)
    for name in ("out.npy", "out.tif"):
        code, _, said = command("scale", "box", tmp_path / "photo.png", tmp_path / name)
        assert (code, "No space left on device" in " ".join(said.split())) == (2, True)
    assert [file.name for file in tmp_path.iterdir()] == ["photo.png"]


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
        ("source must be an array of NumPy", ["box", "empty.npy", "out.npy"]),
        ("target must not be a file that is read", ["box", "photo.png", "photo.png"]),
    ],
)
def test_what_does_not_fit_is_refused(command, tmp_path, message, words):
    write_image(tmp_path / "photo.png", IMAGE)
    (tmp_path / "empty.npy").touch()
    name, source, target, *options = words
    code, _, said = command("scale", name, tmp_path / source, tmp_path / target, *options)
    assert code == 2
    assert message in " ".join(said.split())
    assert not (tmp_path / "out.npy").exists()
