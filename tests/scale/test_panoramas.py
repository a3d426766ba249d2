"""Heaps of files: the panoramas are those of the images in memory, in every bit."""

import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from skimage import data

import cvkern
from cvkern import scale
from cvkern.images import write_image
from cvkern.panorama import blending
from tests.panorama.scenes import through

SHAPE = 200, 250


def views():
    """Return four photographs of a sheet, and one of something else."""
    sheet, rng = data.coffee(), np.random.default_rng(0)
    found = []
    for n in range(4):
        tilt = rng.normal(0, 2e-5, 2)
        found.append(
            through(sheet, np.array([[1, 0, -10 - 100 * n], [0, 1, -90], [*tilt, 1]]), SHAPE)
        )
    return [*found, data.astronaut()[:130, :160]]


def heap(folder, images):
    folder.mkdir()
    for n, image in enumerate(images):
        write_image(folder / f"{n:03}.png", image)
    return folder


def same(got, want):
    for name, one, other in zip(want._fields, got, want, strict=True):
        if name in ("image", "mask"):
            assert one.dtype == other.dtype
            one, other = one[:], other[:]
        np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.parametrize("suffix", [".npy", ".tif", ".zarr"])
def test_a_heap_of_files(tmp_path, backend, suffix):
    if suffix == ".zarr":
        pytest.importorskip("zarr")
    images = views()
    folder, said = heap(tmp_path / "in", images), []
    (want,) = cvkern.stitch(images)
    found = scale.stitch(
        folder, tmp_path / "out", suffix=suffix, progress=lambda *step: said.append(step)
    )
    assert found.failed == {}
    same(found.panoramas[0], want)
    assert want.members == [0, 1, 2, 3]
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {f"panorama-1{suffix}", f"panorama-1-mask{suffix}"}
    texts = list(dict.fromkeys(text for *_, text in said))
    assert texts == ["Keypoints", "Matching", "Homographies", "Panorama 1 of 1"]


def test_tiles_of_another_size(tmp_path, monkeypatch):
    images = views()
    folder = heap(tmp_path / "in", images)
    given = {"bands": 2, "compensate": False, "surface": "plane", "focal_lengths": [300.0] * 5}
    (whole,) = cvkern.stitch(images, **given)
    found = scale.stitch(folder, tmp_path / "out", tile=67, max_bytes=0, **given)
    away = found.panoramas[0].image.astype(int) - whole.image
    assert np.abs(away).max() <= 1
    np.testing.assert_array_equal(found.panoramas[0].mask, whole.mask)
    monkeypatch.setitem(blending.TILES, "cpu", 64)  # 67, in whole pixels of the coarsest band
    same(found.panoramas[0], cvkern.stitch(images, **given)[0])


def test_what_is_broken_or_of_another_kind(tmp_path):
    """A broken file is named; a photograph of 16 bits joins those of 8, and two dtypes are told."""
    images = views()
    folder = heap(tmp_path / "in", images)
    (want,) = cvkern.stitch(images)
    (folder / "001a.png").write_bytes((folder / "001.png").read_bytes()[:999])
    write_image(folder / "002.png", images[2].astype(np.uint16) * 257)
    found = scale.stitch(folder, tmp_path / "out", focal_lengths="exif")
    assert [os.path.basename(path) for path in found.files][2] == "001a.png"
    assert list(found.failed) == [found.files[2]]
    assert found.failed[found.files[2]].startswith("ValueError: path must be a readable image")
    (panorama,) = found.panoramas
    assert panorama.members == [0, 1, 3, 4]
    assert panorama.pairs == [(i + (i > 1), j + (j > 1)) for i, j in want.pairs]
    assert panorama.image.dtype == np.uint8
    assert panorama.image.shape == want.image.shape
    # The small copy was made before the bytes were rounded: seams may lie a pixel apart.
    assert np.median(np.abs(panorama.image.astype(int) - want.image)) == 0
    groups = scale.recognize_panoramas(folder, engine="processes")
    assert groups.components == [[0, 1, 3, 4], [5]]
    assert groups.pairs == panorama.pairs
    assert groups.failed == found.failed
    with pytest.raises(ValueError, match=r"paths must name images that can be read, got '.*001a"):
        scale.stitch([folder / "001a.png"], tmp_path / "none")


RUN = """
import sys, time
from cvkern import scale
def progress(done, of, text):
    print(done, text, flush=True)
    time.sleep(float(sys.argv[3]))
scale.stitch(sys.argv[1], sys.argv[2], tile=64, bands=2, workers=1, progress=progress)
"""


def test_a_killed_run_goes_on(tmp_path):
    """It is killed among the keypoints, then among the tiles."""
    images = views()
    folder, out = heap(tmp_path / "in", images), tmp_path / "out"
    words = [sys.executable, "-c", textwrap.dedent(RUN), folder, out]
    said = []
    for last, number in (("3 Keypoints", 1), ("Panorama", 5)):
        run = subprocess.Popen([*words, "0.1"], stdout=subprocess.PIPE, text=True)
        assert run.stdout
        said.append([])
        while sum(last in line for line in said[-1]) < number:
            said[-1].append(run.stdout.readline().strip())
            assert run.poll() is None
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        run.stdout.close()
    notes = out / "journal"
    tiles = {path.name for path in notes.glob("tiles/0-*.npz")}
    assert tiles
    assert said[1][0] == "4 Keypoints"
    changed = {path: path.stat().st_mtime_ns for path in notes.rglob("*.npz")}
    with pytest.raises(ValueError, match="journal must be of the same call"):
        scale.stitch(folder, out, tile=64, bands=3, workers=1)
    first = min(folder.iterdir())
    time = first.stat().st_mtime_ns
    os.utime(first, ns=(time, time + 1))  # another photograph of as many bytes is another call
    with pytest.raises(ValueError, match="journal must be of the same call"):
        scale.stitch(folder, out, tile=64, bands=2, workers=1)
    os.utime(first, ns=(time, time))
    assert {path: path.stat().st_mtime_ns for path in notes.rglob("*.npz")} == changed
    rest = subprocess.run([*words, "0"], check=True, capture_output=True, text=True).stdout
    drawn = [line for line in rest.splitlines() if "Panorama" in line]
    want = scale.stitch(folder, tmp_path / "again", tile=64, bands=2).panoramas[0]
    every = -(-want.image.shape[0] // 64) * -(-want.image.shape[1] // 64)
    assert len(drawn) == 1 + every - len(tiles)
    assert "Keypoints" not in rest
    assert "Matching" not in rest
    np.testing.assert_array_equal(np.load(out / "panorama-1.npy"), want.image)
    np.testing.assert_array_equal(np.load(out / "panorama-1-mask.npy"), want.mask)
    assert not notes.exists()


GROWTH = """
import sys, threading
from cvkern import scale
def anonymous():
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("RssAnon"))
most, done = 0.0, threading.Event()
def watch():
    global most
    while not done.wait(0.005):
        most = max(most, anonymous())
thread = threading.Thread(target=watch)
thread.start()
try:
    for n in (1, 3, 5):  # what the first one leaves in memory is there in both of the others
        found = scale.stitch(*sys.argv[n : n + 2], tile=1024, bands=2, max_bytes=2**23)
        print(len(found.panoramas[0].members), most)
finally:
    done.set()
    thread.join()
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="memory is read from /proc")
def test_memory_does_not_grow_with_the_photographs(tmp_path):
    """Photographs of 7.2 MB: what their number adds is a part of their size."""
    rng, spots = np.random.default_rng(0), np.zeros((1500, 5800), np.float32)
    # Few keypoints, which match fast.
    spots[rng.integers(0, 1500, 600), rng.integers(0, 5800, 600)] = rng.uniform(1e4, 1e5, 600)
    spots = cvkern.gaussian(spots, 8)
    wide = np.repeat(spots.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)
    cuts = [wide[:, 350 * n : 350 * n + 1600] for n in range(13)]
    few, many = heap(tmp_path / "few", cuts[:4]), heap(tmp_path / "many", cuts)
    words = [few, tmp_path / "a", few, tmp_path / "b", many, tmp_path / "c"]
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(GROWTH), *words],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    members, most = zip(*(line.split() for line in done.stdout.splitlines()), strict=True)
    assert members == ("4", "4", "13")
    assert float(most[2]) - float(most[1]) < 30  # 9 photographs more have 65 MB


@pytest.mark.parametrize(
    ("error", "message", "options"),
    [
        (TypeError, "options must be among surface, .*, got crop", {"crop": True}),
        (ValueError, "suffix must be one of .npy, .tif, .zarr, got '.png'", {"suffix": ".png"}),
        (ValueError, "tile must be in", {"tile": 0}),
        (ValueError, "max_bytes must be in", {"max_bytes": -1}),
        (ValueError, "focal_lengths must be", {"focal_lengths": "guess"}),
        (ValueError, r"focal_lengths must have shape \(1,\)", {"focal_lengths": [1.0, 2.0]}),
        (ValueError, "surface must be", {"surface": "cube"}),
        (ValueError, "workers must be", {"workers": 0}),
        (ValueError, "engine must be", {"engine": "spark"}),
        (ValueError, "paths must name at least one image", {"paths": []}),
        (ValueError, "data_range must be", {"data_range": 0}),
        (ValueError, "target must have no panoramas yet, got '.*panorama-3.npy'", {}),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, error, message, options):
    (tmp_path / "panorama-3.npy").touch()
    call = {"paths": [tmp_path / "a.png"], "target": tmp_path} | options
    with pytest.raises(error, match=message):
        scale.stitch(**call)
    assert [path.name for path in tmp_path.iterdir()] == ["panorama-3.npy"]


def test_old_panoramas_are_replaced_when_asked(tmp_path):
    images = views()[:2]
    folder, out = heap(tmp_path / "in", images), tmp_path / "out"
    out.mkdir()
    for name in ("panorama-1.npy", "panorama-2.npy", "panorama-x.npy"):
        (out / name).touch()
    found = scale.stitch(folder, out, overwrite=True)
    same(found.panoramas[0], cvkern.stitch(images)[0])
    written = {path.name for path in out.iterdir()}
    assert written == {"panorama-1.npy", "panorama-1-mask.npy", "panorama-x.npy"}
    with pytest.raises(ValueError, match="target must not hold a file of paths"):
        scale.stitch([*folder.iterdir(), out / "panorama-1.npy"], out, overwrite=True)
    assert written == {path.name for path in out.iterdir()}
    large, said = tmp_path / "large", []
    with pytest.raises(ValueError, match="max_pixels must be at least"):
        scale.stitch(folder, large, max_pixels=1000)
    # Whoever takes the advice waits neither for keypoints nor for pairs.
    small = scale.stitch(folder, large, scale=0.1, progress=lambda *step: said.append(step[2]))
    assert {text.split()[0] for text in said} == {"Panorama"}
    same(small.panoramas[0], cvkern.stitch(images, scale=0.1)[0])
    assert not (large / "journal").exists()
