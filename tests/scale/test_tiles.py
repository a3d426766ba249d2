"""Tiles give what the whole image gives, in every bit, and a killed run goes on."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from typing import Any

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.scale import TILED, apply, edges, halo

FILTERS = [
    ("gaussian", {"sigma": 2}),
    ("gaussian", {"sigma": (1, 6), "mode": "constant", "cval": 3, "truncate": 2.5}),
    ("gaussian", {"sigma": 1, "dtype": "uint8"}),
    ("correlate_separable", {"taps": ([1, -2, 0.5, 0, 1], [0.25, 3, 1]), "mode": "nearest"}),
    ("median", {"radius": 2, "mode": "mirror"}),
    ("box", {"radius": (1, 4)}),
    ("sobel", {"mode": "constant", "cval": 9}),
    ("prewitt", {"axis": 0}),
    ("scharr", {"axis": 1}),
    ("sobel_h", {}),
    ("sobel_v", {}),
    ("laplace", {"mode": "nearest"}),
    ("gradient", {"sigma": 1.2}),
    ("gradient", {"operator": "sobel", "sigma": 0}),
]
EDGES = [
    {"sigma": 2, "low_threshold": 1, "high_threshold": 30},
    {"sigma": 1.5, "operator": "gaussian", "mode": "reflect", "low_threshold": 2,
     "high_threshold": 25},
    {"sigma": 0, "suppression": "sectors", "norm": "l1", "low_threshold": 20,
     "high_threshold": 200, "mode": "nearest"},
    {"sigma": 1, "use_quantiles": True, "low_threshold": 0.8, "high_threshold": 0.93},
    {"sigma": 1.5, "use_quantiles": True, "norm": "l1", "operator": "gaussian"},
]  # fmt: skip


def same(got, want):
    got, want = (x if isinstance(x, tuple) else (x,) for x in (got, want))
    for one, other in zip(got, want, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def noise():
    return np.random.default_rng(0).integers(0, 256, (61, 97), np.uint8)


def test_every_function_with_a_halo_is_tried():
    tried = {"canny", "hough_circle", "hough_line", "stereo_match"}
    tried |= {"generalized_hough", "generalized_hough_votes"}
    assert {name for name, _ in FILTERS} | tried == set(TILED)


@pytest.mark.parametrize("tile", [5, (23, 40), 1000])
@pytest.mark.parametrize("case", FILTERS, ids=lambda case: case[0])
def test_filters(backend, case, tile):
    name, options = case
    same(apply(name, noise(), tile=tile, **options), getattr(cvkern, name)(noise(), **options))


@pytest.mark.parametrize("options", EDGES)
def test_edges_go_on_across_seams(backend, options):
    whole = skimage.data.camera()[100:300, 50:261]
    for image in (whole, cvkern.gaussian(noise(), 1.2)):
        for tile in (32, (11, 64), (200, 7)):
            same(apply(cvkern.canny, image, tile=tile, **options), cvkern.canny(image, **options))


def test_an_edge_that_winds_through_many_tiles(backend):
    """Its only strong part is at one end."""
    image = np.zeros((80, 80), np.float32)
    for row in range(4, 76, 8):
        image[row : row + 4, 4:76] = 10
        image[row : row + 8, (72 if row % 16 == 4 else 4) : (76 if row % 16 == 4 else 8)] = 10
    image[4:8, 4:24] = 12
    options = {"sigma": 0.5, "low_threshold": 5, "high_threshold": 36}
    whole = cvkern.canny(image, **options)
    assert whole.sum() > 1000
    for tile in (13, (36, 80)):
        same(apply("canny", image, tile=tile, **options), whole)


@pytest.mark.parametrize("few", [0, 3])
def test_a_flood_finds_what_a_search_from_the_border_does_not(backend, monkeypatch, few):
    image, options = cvkern.gaussian(noise(), 1.2), EDGES[0]
    monkeypatch.setattr(edges, "_FEW", few)
    same(apply("canny", image, tile=32, **options), cvkern.canny(image, **options))


def test_votes_over_tiles_are_those_of_the_image(backend):
    image = skimage.data.camera()[100:250, 50:240]
    edges = cvkern.canny(image, 1.5, 10, 40)
    turn, weight = cvkern.gradient(image).orientation, np.random.default_rng(0).random(edges.shape)
    directed: dict[str, Any] = {"orientation": turn, "orientation_tolerance": 0.1}
    lines: list[dict[str, Any]] = [
        {}, {"rho_step": 0.7, "theta": np.linspace(-1.5, 1.5, 50)}, directed, {"weights": weight},
    ]  # fmt: skip
    for given in lines:
        got = apply("hough_line", edges, tile=(37, 64), **given)
        same(got, cvkern.hough_line(edges, **given))
    circles: list[dict[str, Any]] = [
        {"radius": [5, 9, 30]}, {"radius": 7, "normalize": False} | directed,
    ]  # fmt: skip
    for given in circles:
        got = apply("hough_circle", edges, tile=(37, 64), **given)
        same(got, cvkern.hough_circle(edges, **given))
    target = np.zeros((2, *edges.shape), np.float32)
    assert apply("hough_circle", edges, target, tile=40, radius=[3, 8]) is target
    same(target, cvkern.hough_circle(edges, [3, 8]))


def test_shapes_over_tiles_are_those_of_the_image(backend):
    scene = np.zeros((150, 190), np.float32)
    for row, column in ((20, 30), (80, 110)):
        scene[row : row + 45, column : column + 18] = 1
        scene[row + 27 : row + 45, column : column + 40] = 1
    table = cvkern.r_table(scene[10:75, 20:80])
    edges, turn = cvkern.canny(scene, 1.0), cvkern.gradient(scene, sigma=1.0).orientation
    given: dict[str, Any] = {"table": table, "orientation": turn, "rotations": 12}
    for tile in (64, (150, 37)):
        got = apply("generalized_hough_votes", edges, tile=tile, **given)
        same(got, cvkern.generalized_hough_votes(edges, **given))
        found = apply("generalized_hough", edges, tile=tile, **given)
        same(found, cvkern.generalized_hough(edges, **given))
        assert len(found.position) >= 2
    assert len(apply("generalized_hough", np.zeros_like(edges), tile=64, **given).position) == 0
    with pytest.raises(ValueError, match="orientation must be given in tiles"):
        apply("generalized_hough", edges, table=table)


def test_strips_of_a_pair(backend):
    left = cvkern.gaussian(np.random.default_rng(0).random((230, 96)), 1)
    right = np.roll(left, -5, axis=1)
    given: dict[str, Any] = {"disparities": (0, 16), "data_range": 1.0}
    exact = given | {"method": "window", "window": 7, "speckle_size": 0}
    pair = cvkern.stereo_match
    want = pair(left, right, **exact)
    assert want.valid.any(axis=1).all()
    got = apply("stereo_match", (left, right), tile=50, **exact)
    assert isinstance(got, type(want))
    same(got, want)
    got, want = apply("stereo_match", (left, right), tile=50, **given), pair(left, right, **given)
    assert (got.disparity == want.disparity).mean() > 0.999
    with pytest.raises(ValueError, match="source must be a tuple of 2 images, got 1"):
        apply("stereo_match", left, **given)
    # The dark strips have the white of the whole pair.
    left = np.rint(4000 * left).astype(np.uint16)
    left[:150] //= 8
    del exact["data_range"]
    for dtype in (np.uint16, np.float32):
        images = left.astype(dtype), np.roll(left, -5, axis=1).astype(dtype)
        same(apply("stereo_match", images, tile=50, **exact), pair(*images, **exact))


def test_devices_take_tiles_in_turn(backend):
    image = skimage.data.camera()[100:300, 50:261]
    options: dict[str, Any] = {"sigma": 1.5, "low_threshold": 1, "high_threshold": 40}
    got = apply("canny", image, tile=40, devices=("cpu", "cpu", "cpu"), **options)
    same(got, cvkern.canny(image, **options))
    with pytest.raises(ValueError, match="device must be one that"):
        apply("box", image, devices=("cpu", "cuda:77"))


def test_arrays_of_zarr(tmp_path):
    zarr = pytest.importorskip("zarr")
    image = skimage.data.camera()[100:300, 50:261]
    source = zarr.create_array(tmp_path / "in", shape=image.shape, chunks=(64, 50), dtype="u1")
    target = zarr.create_array(tmp_path / "out", shape=image.shape, chunks=(32, 64), dtype=bool)
    source[:] = image
    apply("canny", source, target, tile=64, sigma=2)
    same(target[:], cvkern.canny(image, 2))


def test_images_of_pyvips():
    pyvips = pytest.importorskip("pyvips")
    color = skimage.data.astronaut()[:90, :130]
    for image, axis in ((color, -1), (color[..., 0], None)):
        source = pyvips.Image.new_from_array(image)
        got = apply("median", source, tile=40, channel_axis=axis)
        same(got, cvkern.median(image, channel_axis=axis))


def test_colours_and_masks(backend):
    color = skimage.data.astronaut()[:90, :130]
    mask = np.random.default_rng(1).random(color.shape[:2]) > 0.01
    same(apply("canny", color, tile=40, mask=mask), cvkern.canny(color, mask=mask))
    same(apply("sobel", color, tile=40, mask=mask), cvkern.sobel(color, mask))
    got = apply("gaussian", color, tile=40, sigma=2, channel_axis=-1)
    same(got, cvkern.gaussian(color, 2, channel_axis=-1))


def test_files_are_read_and_written_in_place(tmp_path):
    source = np.lib.format.open_memmap(tmp_path / "in.npy", "w+", np.uint8, noise().shape)
    source[:] = noise()
    targets = [
        np.lib.format.open_memmap(tmp_path / f"{n}.npy", "w+", np.float32, noise().shape)
        for n in range(4)
    ]
    seen = []
    got = apply("gradient", source, targets, tile=50, progress=lambda *n: seen.append(n))
    assert all(one is target for one, target in zip(got, targets, strict=True))
    same(tuple(np.load(tmp_path / f"{n}.npy") for n in range(4)), tuple(cvkern.gradient(noise())))
    assert seen == [(n, 4) for n in (1, 2, 3, 4)]


def test_no_thread_outlives_a_failure():
    """Or Python ends it when it collects the traceback, in any thread, which may hang."""

    def stop(done, of):
        raise KeyError(done)

    image = np.zeros((60, 70), np.uint8)
    apply("gaussian", image, tile=20)  # starts the threads of kernels
    before = threading.active_count()
    with pytest.raises(KeyError) as caught:
        apply("gaussian", image, tile=20, progress=stop)
    assert caught.traceback  # holds what was not closed
    assert threading.active_count() == before


def test_arrays_of_dask(tmp_path):
    da = pytest.importorskip("dask.array")
    image = skimage.data.camera()[100:300, 50:261]
    lazy = da.from_array(image, chunks=(60, 90))
    edges = {"sigma": 1.5, "low_threshold": 1, "high_threshold": 40}
    found = apply("canny", lazy, tile=(37, 50), mask=lazy > 9, **edges)
    assert found.chunks[0] == (37, 37, 37, 37, 37, 15)
    same(found.compute(), cvkern.canny(image, mask=image > 9, **edges))
    seen = apply("gradient", lazy, tile=64, sigma=1)
    same(da.compute(*seen), tuple(cvkern.gradient(image, sigma=1)))
    color = da.from_array(skimage.data.astronaut()[:90, :130], chunks=50)
    target = np.zeros(color.shape, np.float32)
    assert apply("gaussian", color, target, tile=40, sigma=2, channel_axis=-1) is target
    same(target, cvkern.gaussian(color.compute(), 2, channel_axis=-1))
    with pytest.raises(ValueError, match="journal and progress must be None for an array of Dask"):
        apply("box", lazy, journal=tmp_path / "journal")


RUN = """
import sys, time
import numpy as np
from cvkern.scale import apply

source, target = np.load(sys.argv[1]), np.lib.format.open_memmap(sys.argv[2], "r+")
slow = float(sys.argv[4])
seen = []
def progress(done, of):
    seen.append(done)
    print(done, flush=True)
    time.sleep(slow)
apply("canny", source, target, tile=24, journal=sys.argv[3], progress=progress,
      sigma=1.0, low_threshold=1.0, high_threshold=60.0)
"""


def test_a_killed_run_goes_on(tmp_path):
    image = cvkern.gaussian(noise(), 1.0)
    source, target, journal = tmp_path / "in.npy", tmp_path / "out.npy", tmp_path / "journal"
    np.save(source, image)
    np.save(target, np.zeros(image.shape, bool))
    words = [sys.executable, "-c", textwrap.dedent(RUN), source, target, journal]
    kept = 0
    for _ in range(3):
        run = subprocess.Popen([*words, "0.2"], stdout=subprocess.PIPE, text=True)
        assert run.stdout
        for _ in range(4):
            assert run.stdout.readline()
        time.sleep(0.05)
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        run.stdout.close()
        before, kept = kept, len(list(journal.glob("*.npz")))
        assert before + 3 <= kept < 15
    done = subprocess.run([*words, "0"], check=True, capture_output=True, text=True).stdout.split()
    assert done == [str(n) for n in range(kept + 1, 16)]
    want = cvkern.canny(image, 1.0, 1.0, 60.0)
    same(np.load(target), want)
    assert want.any()
    assert not journal.exists()


class Changing:
    """An image that another program replaces after some windows were read."""

    shape, dtype = (61, 97), np.dtype(np.uint8)

    def __init__(self, later):
        self.later, self.read = later, 0

    def __getitem__(self, window):
        self.read += 1
        return (noise() if self.read < 4 else self.later)[window]


@pytest.mark.parametrize("name", ["box", "canny", "hough_line"])
@pytest.mark.parametrize("later", [np.zeros((61, 70), np.uint8), np.zeros((9, 9, 97), np.uint8)])
def test_a_source_that_changes_its_size(name, later):
    with pytest.raises(ValueError, match="source must keep its shape, got"):
        apply(name, Changing(later), tile=30)


class Damaged(Changing):
    """An image of which a part cannot be decoded."""

    def __getitem__(self, window):
        raise RuntimeError("invalid input data")


def test_a_source_that_cannot_be_read():
    with pytest.raises(ValueError, match="source must be readable, got Damaged: invalid input"):
        apply("box", Damaged(None), tile=30)


def test_tiles_are_not_listed_without_a_bound():
    image = np.broadcast_to(np.uint8(0), (2**20, 2**20))
    with pytest.raises(ValueError, match=r"tile must give at most 4194304 tiles, got \[3, 3\] for"):
        apply("box", image, tile=3)


def test_a_file_that_becomes_shorter(tmp_path):
    np.save(tmp_path / "in.npy", noise())
    source = np.load(tmp_path / "in.npy", mmap_mode="r")
    os.truncate(tmp_path / "in.npy", 4096)
    with pytest.raises(ValueError, match="source must keep its size, got a file of 4096 bytes"):
        apply("box", source)


def test_a_target_that_is_read(tmp_path):
    image = noise()
    source = np.lib.format.open_memmap(tmp_path / "in.npy", "w+", np.uint8, image.shape)
    again = np.load(tmp_path / "in.npy", mmap_mode="r+")
    for one, other in ((image, image), (image[:, ::-1], image), (source, again)):
        with pytest.raises(ValueError, match="target must not be source"):
            apply("median", one, other, tile=30)
    both = np.zeros((2, 61, 97), np.uint8)
    apply("median", both[0], both[1], tile=30)


@pytest.mark.parametrize(
    ("error", "message", "call"),
    [
        (ValueError, "function must be one of box, canny", lambda: apply("sift", noise())),
        (ValueError, "function must be one of", lambda: halo(np.median)),
        (TypeError, "options must be those of box", lambda: apply("box", noise(), size=3)),
        (ValueError, "mode must not be 'wrap' in tiles: a tile at one border",
         lambda: apply("box", noise(), mode="wrap")),
        (ValueError, r"source must be an array of shape \(H, W\)", lambda: apply("box", [1, 2])),
        (ValueError, r"target must have shape \(61, 97\), got \(61, 98\)",
         lambda: apply("box", noise(), np.zeros((61, 98), np.float32))),
        (ValueError, "target must hold float32, got float64",
         lambda: apply("box", noise(), np.zeros((61, 97)))),
        (ValueError, r"mask must have shape \(61, 97\), got \(3, 3\)",
         lambda: apply("sobel", noise(), mask=np.ones((3, 3)))),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(error, message, call):
    with pytest.raises(error, match=message):
        call()


def test_a_journal_of_another_call_is_refused(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").touch()
    with pytest.raises(ValueError, match="journal must name a new or empty folder"):
        apply("box", noise(), journal=tmp_path / "full")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "plan.json").write_text("{}")
    with pytest.raises(ValueError, match="journal must be of the same call"):
        apply("box", noise(), journal=tmp_path / "other")
