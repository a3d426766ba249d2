"""``cvkern panorama``: what it writes, says and refuses."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from cvkern.images import read_image, write_image
from cvkern.images._exif import focal_length
from tests.panorama.scenes import photograph, turned, wall

FOCAL = 210.0


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Make three photographs of a panorama, one of them on its side, a stranger and a text."""
    folder = tmp_path_factory.mktemp("photographs")
    picture = wall(FOCAL, 330)
    views = [photograph(picture, FOCAL, turned(25 * i, 1), FOCAL, (170, 240)) for i in range(3)]
    for i, view in enumerate(views):
        exif = Image.Exif()
        if i == 1:  # stored on its side: to be turned by 90 degrees clockwise
            exif[0x0112] = 6
            view = np.rot90(view)
        exif.get_ifd(0x8769)[0xA405] = round(FOCAL / np.hypot(170, 240) * np.hypot(36, 24))
        Image.fromarray(np.ascontiguousarray(view)).save(
            folder / f"{'cab'[i]}.jpg", exif=exif, quality=95
        )
    stranger = photograph(picture, FOCAL, turned(180), FOCAL, (170, 240))
    write_image(folder / "stranger.png", stranger)
    (folder / "notes.txt").write_text("no photograph")
    return folder


def test_panorama(command, photographs, tmp_path):
    code, out, _ = command("panorama", photographs, "-o", tmp_path / "out")
    assert code == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["photographs"] == ["a.jpg", "b.jpg", "c.jpg", "stranger.png"]
    assert report["strangers"] == ["stranger.png"]
    (entry,) = report["panoramas"]
    assert entry["members"] == ["a.jpg", "b.jpg", "c.jpg"]
    assert ["a.jpg", "c.jpg"] in report["pairs"]
    assert np.abs(np.array(entry["focal_lengths"]) / FOCAL - 1).max() < 0.02
    image = read_image(tmp_path / "out" / entry["file"])
    assert image.shape == (entry["height"], entry["width"])
    assert f"{entry['width']} x {entry['height']} pixels" in out
    assert "1 panoramas, 1 strangers" in out

    code, _, error = command("panorama", photographs, "-o", tmp_path / "out")
    assert code == 2
    assert "--overwrite replaces them" in error
    code, _, error = command("panorama", photographs, "-o", tmp_path / "b", "--max-pixels", "1000")
    assert code == 2
    assert "of the panorama of images a.jpg, b.jpg, c.jpg, got 1000" in " ".join(error.split())
    stale = tmp_path / "out" / "panorama-7.png"
    write_image(stale, image)
    code, _, _ = command(
        "panorama", photographs, "-o", tmp_path / "out", "--overwrite", "--scale", "0.5", "--crop"
    )
    assert code == 0
    assert not stale.exists()
    assert read_image(tmp_path / "out" / "panorama-1.png").shape[1] < 0.6 * image.shape[1]


def test_large_panoramas_are_those_of_memory(command, photographs, tmp_path):
    folder = tmp_path / "heap"
    shutil.copytree(photographs, folder)
    (folder / "bad.jpg").write_bytes((folder / "a.jpg").read_bytes()[:900])
    code, _, error = command("panorama", folder, "-o", tmp_path / "small")
    assert code == 0
    (tmp_path / "large").mkdir()
    (tmp_path / "large" / "panorama-1.png").touch()
    given = "panorama", folder, "-o", tmp_path / "large", "--large", ".tif"
    code, out, _ = command(*given)
    assert code == 2
    code, out, again = command(*given, "--overwrite")
    assert code == 0
    assert again == error
    assert "1 panoramas, 1 strangers" in out
    names = {path.name for path in (tmp_path / "large").iterdir()}
    assert names == {"panorama-1.tif", "panorama-1-mask.tif", "report.json"}
    want = read_image(tmp_path / "small" / "panorama-1.png")
    np.testing.assert_array_equal(read_image(tmp_path / "large" / "panorama-1.tif"), want)
    reports = [
        json.loads((tmp_path / name / "report.json").read_text()) for name in ("small", "large")
    ]
    assert reports[1]["panoramas"][0].pop("file") == "panorama-1.tif"
    assert reports[0]["panoramas"][0].pop("file") == "panorama-1.png"
    assert reports[1] == reports[0]
    code, _, error = command(*given, "--overwrite", "--crop")
    assert code == 2
    assert "crop must not be given with large" in error


def test_a_damaged_file_and_one_of_words(command, photographs, tmp_path):
    folder = tmp_path / "heap"
    folder.mkdir()
    for name in ("a.jpg", "c.jpg"):
        (folder / name).write_bytes((photographs / name).read_bytes())
    (folder / "bad.jpg").write_bytes((photographs / "a.jpg").read_bytes()[:900])
    gray = read_image(photographs / "b.jpg")
    gray = (gray if gray.ndim == 2 else gray[..., 0]).astype(np.uint16) * 257
    write_image(folder / "b.png", gray)
    code, _, error = command("panorama", folder, "-o", tmp_path / "out")
    assert code == 0
    assert "bad.jpg: left out, it cannot be read: " in error
    assert "b.png: uint16 became uint8, as most are" in error
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert list(report["unreadable"]) == ["bad.jpg"]
    assert report["panoramas"][0]["members"] == ["a.jpg", "b.png", "c.jpg"]
    for name in ("a.jpg", "b.png", "c.jpg"):
        (folder / name).unlink()
    code, _, error = command("panorama", folder, "-o", tmp_path / "none")
    assert code == 2
    assert "folder must have images that can be read, got 'bad.jpg'" in error
    assert not (tmp_path / "none").exists()


def test_what_is_refused_writes_nothing(command, photographs, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    for arguments, said in (
        ((tmp_path / "none", "-o", tmp_path / "o"), "folder must be a folder that exists"),
        ((empty, "-o", tmp_path / "o"), "folder must have images, got none"),
        ((photographs, "-o", photographs / "a.jpg"), "output must be a folder, got the file"),
        (
            (photographs, "-o", tmp_path / "o", "--max-pixels", "9000"),
            "max_pixels must be at least",
        ),
    ):
        code, _, error = command("panorama", *arguments)
        assert code == 2
        assert said in error
    assert not (tmp_path / "o").exists()


def test_focal_length(photographs, tmp_path):
    told = focal_length(photographs / "a.jpg", (170, 240))
    assert told is not None
    assert told == pytest.approx(FOCAL, rel=0.02)
    assert focal_length(photographs / "a.jpg", (85, 120)) == pytest.approx(told / 2)
    assert focal_length(photographs / "stranger.png", (170, 240)) is None
    assert focal_length(photographs / "notes.txt", (170, 240)) is None
    exif = Image.Exif()
    lens = exif.get_ifd(0x8769)
    # 50 mm, 100 pixels in a centimetre, of a picture of 3000 x 2000 pixels.
    lens[0x920A], lens[0xA20E], lens[0xA210], lens[0xA002], lens[0xA003] = 50, 100, 3, 3000, 2000
    Image.new("L", (30, 20)).save(tmp_path / "lens.jpg", exif=exif)
    assert focal_length(tmp_path / "lens.jpg", (20, 30)) == pytest.approx(50 * 10 / 100)
    assert focal_length(tmp_path / "lens.jpg", (20, 20)) is None
