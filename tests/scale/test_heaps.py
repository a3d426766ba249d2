"""Heaps of files: every result is that of the function, and what fails stops nothing."""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

import cvkern
from cvkern.images import read_image, write_image
from cvkern.scale import engines, map_images


class Table:
    """A data frame: when it is iterated, it gives the names of its columns."""

    def __init__(self, shape):
        self.shape = shape

    def __array__(self, dtype=None, copy=None):
        return np.full(self.shape, "a.png")

    def __iter__(self):
        return iter(("first.png", "second.png"))


def heap(folder, number=6):
    folder.mkdir()
    for n in range(number):
        image = np.random.default_rng(n).integers(0, 256, (20 + n, 31), np.uint8)
        write_image(folder / f"{n}.png", image)
    (folder / "broken.png").write_bytes((folder / "0.png").read_bytes()[:60])
    return folder


def check(report, folder, target):
    assert sorted(os.path.basename(f) for f in report.done) == [f"{n}.png" for n in range(6)]
    assert [os.path.basename(f) for f in report.failed] == ["broken.png"]
    (reason,) = report.failed.values()
    assert reason.startswith("ValueError: path must be a readable image")
    assert len(list(target.iterdir())) == 6
    for n in range(6):
        want = cvkern.gaussian(read_image(folder / f"{n}.png"), 1.5)
        np.testing.assert_array_equal(np.load(target / f"{n}.npy"), want)


def blurred_or_dead(image, sigma, mark):
    if len(image) == 23 and not os.path.exists(mark):
        open(mark, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return cvkern.gaussian(image, sigma)


def dead(image):
    os.kill(os.getpid(), signal.SIGKILL)


def test_processes(tmp_path):
    """One is killed in the middle of a file, once; another function kills all of them."""
    folder, out, mark = heap(tmp_path / "in"), tmp_path / "out", str(tmp_path / "killed")
    given = {"engine": "processes", "sigma": 1.5, "mark": mark}
    check(map_images(folder, blurred_or_dead, out, **given), folder, out)
    assert os.path.exists(mark)
    report = map_images([folder / "0.png"], dead, out, engine="processes", overwrite=True)
    assert next(iter(report.failed.values())).startswith("BrokenProcessPool: ")


@pytest.mark.parametrize("engine", ["threads", "dask", "ray"])
def test_engines(tmp_path, engine):
    """A worker is killed in the middle of its third file, once."""
    pytest.importorskip({"threads": "os", "dask": "distributed", "ray": "ray"}[engine])
    folder, mark = heap(tmp_path / "in"), tmp_path / "killed"

    def blurred(image, sigma):
        if engine != "threads" and len(image) == 23 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return cvkern.gaussian(image, sigma)

    seen = []
    out = tmp_path / "out"
    given = {"sigma": 1.5, "engine": engine, "progress": lambda *n: seen.append(n)}
    check(map_images(folder, blurred, out, **given), folder, out)
    assert seen == [(n, 7) for n in range(1, 8)]
    assert mark.exists() == (engine != "threads")


def test_a_broken_file_among_a_thousand(tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    image = np.random.default_rng(0).integers(0, 256, (8, 10), np.uint8)
    write_image(folder / "000.png", image)
    good = (folder / "000.png").read_bytes()
    for n in range(1, 1000):
        (folder / f"{n:03}.png").write_bytes(good)
    (folder / "617.png").write_bytes(good[:60])
    report = map_images(folder, "box", out, radius=1)
    assert list(report.failed) == [str(folder / "617.png")]
    assert len(report.done) == len(list(out.iterdir())) == 999
    again = map_images(folder, "box", out, radius=1)
    assert (len(again.kept), again.done, again.failed) == (999, [], report.failed)


RUN = """
import sys, time
import cvkern
from cvkern.scale import map_images

def slow(image):
    print(len(image), flush=True)
    time.sleep(float(sys.argv[3]))
    return cvkern.gaussian(image, 1.5)

report = map_images(sys.argv[1], slow, sys.argv[2], workers=1)
print(len(report.done), len(report.kept), len(report.failed))
"""


def test_a_killed_run_does_what_is_left(tmp_path):
    folder = heap(tmp_path / "in")
    words = [sys.executable, "-c", textwrap.dedent(RUN), folder, tmp_path / "out"]
    first = subprocess.Popen([*words, "0.3"], stdout=subprocess.PIPE, text=True)
    assert first.stdout
    while first.stdout.readline().strip() != "22":
        assert first.poll() is None
    time.sleep(0.05)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    first.stdout.close()
    done = subprocess.run([*words, "0"], check=True, capture_output=True, text=True).stdout
    assert done.split("\n")[-2] == "4 2 1"
    assert len(list((tmp_path / "out").glob("*.npy"))) == 6


@pytest.mark.parametrize("engine", ["threads", "dask"])
def test_workers_use_the_kernel_set_in_use(tmp_path, engine):
    pytest.importorskip({"threads": "os", "dask": "distributed"}[engine])
    folder = heap(tmp_path / "in", 1)

    def name(image):
        import cvkern._runtime

        return np.array(list(cvkern._runtime.choice()))

    with cvkern.use(backend="taichi"):
        map_images([folder / "0.png"], name, tmp_path, engine=engine, workers=1)
    assert np.load(tmp_path / "0.npy").tolist() == ["taichi", "cpu"]


def test_forms_of_results(tmp_path):
    folder = heap(tmp_path / "in", 1)
    (folder / "broken.png").unlink()
    image = read_image(folder / "0.png")
    map_images([folder / "0.png"], "gradient", tmp_path, suffix=".npz")
    with np.load(tmp_path / "0.npz") as parts:
        for name, want in cvkern.gradient(image)._asdict().items():
            np.testing.assert_array_equal(parts[name], want)
    map_images(folder, cvkern.median, tmp_path, suffix=".png", radius=1)
    np.testing.assert_array_equal(read_image(tmp_path / "0.png"), cvkern.median(image, 1))
    assert map_images(folder, "median", tmp_path, suffix=".png").kept == [str(folder / "0.png")]
    color = np.stack([image] * 3, axis=2)
    write_image(folder / "color.png", color)
    map_images(folder, "median", tmp_path, suffix=".png")  # channels are the last axis
    want = cvkern.median(color, channel_axis=-1)
    np.testing.assert_array_equal(read_image(tmp_path / "color.png"), want)
    report = map_images(folder, "gaussian", tmp_path, suffix=".png", overwrite=True, size=3)
    assert "TypeError" in report.failed[str(folder / "0.png")]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_a_full_disk_is_the_reason(tmp_path, monkeypatch, suffix):
    folder = heap(tmp_path / "in", 1)
    monkeypatch.setattr(engines, "replacing", lambda _: contextlib.nullcontext("/dev/full"))
    report = map_images([folder / "0.png"], "box", tmp_path, suffix=suffix)
    assert "No space left on device" in next(iter(report.failed.values()))


@pytest.mark.parametrize(
    ("error", "message", "options"),
    [
        (ValueError, "function must be one, or the name", {"function": "blur"}),
        (ValueError, "paths must name at least one image", {"paths": []}),
        (TypeError, "paths must be the path of a folder, or a sequence of paths, got array",
         {"paths": np.uint8(3)}),
        (TypeError, "paths must be .* sequence of paths, got {'a.png': 1}",
         {"paths": {"a.png": 1}}),
        (TypeError, "paths must be .* sequence of paths, got ndarray in Table",
         {"paths": Table(shape=(2, 3))}),
        (ValueError, "paths must have different names, got 'a' twice",
         {"paths": ["a.png", "a.jpg"]}),
        (ValueError, "engine must be 'threads', 'processes', 'dask', 'ray' or a client",
         {"engine": "spark"}),
        (ValueError, "suffix must be one of .npy, .npz", {"suffix": ".exe"}),
        (ValueError, "device must be", {"device": "tpu"}),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(tmp_path, error, message, options):
    call = {"paths": ["a.png"], "function": "box", "target": tmp_path / "out"} | options
    with pytest.raises(error, match=message):
        map_images(**call)
    assert not (tmp_path / "out").exists()


def test_the_files_that_are_read_are_not_replaced(tmp_path):
    folder = heap(tmp_path / "in", 2)
    kept = [file.read_bytes() for file in sorted(folder.iterdir())]
    for target in (folder, tmp_path / "in" / ".." / "in"):
        for overwrite in (False, True):
            with pytest.raises(ValueError, match=r"target must not hold a file of paths, got"):
                map_images(folder, "median", target, suffix=".png", overwrite=overwrite)
    assert [file.read_bytes() for file in sorted(folder.iterdir())] == kept
