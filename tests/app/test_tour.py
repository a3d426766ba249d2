"""The tour: pictures, timings, and a page that needs nothing but the files beside it."""

import importlib.util
import json
import re
import socket
from html.parser import HTMLParser

import numpy as np
import pytest
import skimage.data
from PIL import Image

import cvkern
from cvkern.app.tour import CHAPTERS, clock, radiance, tour
from cvkern.app.tour.page import Chapter, Figure, Panel, Timing
from cvkern.images import read_image

# test_tour_radiance.py makes the other one.
SHOWN = tuple(chapter for chapter in CHAPTERS if chapter is not radiance.chapter)
RUNS = 1  # timed calls of each function, of 7
VOID = {"meta", "img", "br", "link"}


class Tags(HTMLParser):
    """Collect tags and attributes, and hold that every tag is closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.text = [], [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def parse(page):
    tags = Tags()
    tags.feed(page.read_text(encoding="utf-8"))
    assert tags.open == []
    return tags


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Run the tour once, without a network, in a folder that does not exist yet."""

    def refuse(*args, **options):
        raise AssertionError("the tour opened a socket")

    folder = tmp_path_factory.mktemp("tour") / "deep" / "folder"
    steps = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", refuse)
        patch.setattr("cvkern.app.tour.reconstruction.VIEWS", 10)
        patch.setattr("cvkern.app.tour.reconstruction.SIDE", 160)
        patch.setattr("cvkern.app.tour.reconstruction.FOCAL", 240)
        patch.setattr("cvkern.app.tour.clock.RUNS", RUNS)
        page = tour(folder, progress=lambda *step: steps.append(step), chapters=SHOWN)
    assert page == folder / "index.html"
    assert [done for done, _, _ in steps] == list(range(steps[0][1] + 1))
    return folder


def test_pictures(made):
    photo = read_image(made / "edges-scales-photograph.webp")
    assert photo.shape == (300, 451, 3)
    ink = [(read_image(made / f"edges-scales-sigma-{s}.webp") == 20).sum() for s in (1, 2, 4)]
    assert ink[0] > ink[1] > ink[2] > 500
    key = read_image(made / "edges-orientation-key.webp")
    assert key.shape[2] == 4
    assert key[0, 0, 3] == 0
    assert read_image(made / "edges-orientation.webp").std() > 10
    points = read_image(made / "edges-subpixel-points.webp").astype(int)
    orange = (points[..., 0] - points[..., 2]) > 150
    assert 1000 < orange.sum() < 0.1 * orange.size


def test_pictures_of_shapes(made):
    """Outlines are drawn, and one place has the votes."""
    scene = read_image(made / "shapes-scene.webp").astype(int)
    many = read_image(made / "shapes-many.webp").astype(int)
    changed = np.abs(many - scene).max(axis=2) > 60
    outline = (many[..., 0] > 215) & (np.abs(many[..., 1] - 98) < 40) & changed
    assert 2000 < outline.sum() < 0.1 * outline.size
    votes = read_image(made / "shapes-votes.webp").astype(int).sum(axis=2)
    assert (votes > 0.7 * votes.max()).mean() < 0.005  # one peak


def test_pictures_of_stereo(made):
    *_, truth = skimage.data.stereo_motorcycle()
    known = np.isfinite(truth)
    shown, right = (
        read_image(made / f"stereo-{name}.webp").astype(int) for name in ("disparity", "truth")
    )
    # A pixel of disparity is one colour of 64: less than 20 levels of each channel.
    assert (np.abs(shown - right).max(-1) < 20)[known].mean() > 0.85
    assert right[~known].mean() < 20  # black, but for what the file loses at thin lines
    errors = [read_image(made / f"stereo-errors-{name}.webp") for name in ("raw", "matched")]
    coloured = [(np.ptp(image.astype(int), axis=-1) > 90).sum() for image in errors]
    assert coloured[0] > 2 * coloured[1] > 10_000
    with Image.open(made / "stereo-cloud.webp") as film:
        assert film.n_frames == 40
        assert film.size == (400, 270)


def test_pictures_of_paints(made):
    """Twins look like their paints by day, and not in the light of a lamp."""
    day, night = (
        np.abs(
            np.diff(read_image(made / f"colour-{light}.webp")[35::70, 35::70].astype(int), axis=0)
        )
        for light in ("day", "night")
    )
    assert day.shape == (1, 6, 3)
    assert day.max() < 8  # what the file loses: the colours are equal
    assert night.max(axis=-1).min() > 30


def test_timings(made):
    data = json.loads((made / "timings.json").read_text())
    assert data["made_with"]["cvkern"] == cvkern.__version__
    assert {"Kernels", "Device", "Machine", "Python", "NumPy"} <= set(data["made_with"])
    functions = {t["function"] for t in data["timings"]}
    assert functions >= {
        "canny", "detect_circles", "detect_ellipses", "detect_segments", "disparity_to_depth",
        "generalized_hough", "gradient", "hough_circle", "stereo_match", "subpixel_edges",
    }  # fmt: skip
    for timing in data["timings"]:
        assert timing["milliseconds"] > 0
        assert timing["runs"] == RUNS


@pytest.mark.parametrize(("second", "runs", "median"), [(0.03125, 7, 125.0), (1.0, 2, 1500.0)])
def test_the_clock_tells_the_median_of_warm_calls(monkeypatch, second, runs, median):
    ticks, calls = np.repeat([0, 1, 3, 6, 10, 15, 21, 60], 2)[1:-1], []
    times = iter(second * ticks)

    def shrink(image, *, factor):
        calls.append(factor)
        return image[::factor]

    monkeypatch.setattr(clock.time, "perf_counter", lambda: next(times))
    timer = clock.Clock()
    assert timer(shrink, np.zeros((8, 6), np.uint8), factor=2).shape == (4, 6)
    assert calls == [2] * (runs + 1)  # the first compiles
    (timing,) = timer.take()
    assert timing == Timing("shrink", "factor=2", (8, 6), "uint8", median, runs)
    assert timer.take() == ()


def test_page_needs_only_its_files(made):
    tags = parse(made / "index.html")
    images = [attrs for tag, attrs in tags.tags if tag == "img"]
    files = {file.name for file in made.glob("*.webp")}
    assert len(images) == len(files) > 40
    assert {attrs["src"] for attrs in images} == files
    for attrs in images:
        assert attrs["alt"]
        assert attrs["loading"] == "lazy"
        with Image.open(made / attrs["src"]) as picture:
            assert picture.size == (int(attrs["width"]), int(attrs["height"]))
    assert sum(file.stat().st_size for file in made.iterdir()) < 8e6
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in tags.tags}
    text = (made / "index.html").read_text("utf-8")
    assert not re.search(r"https?:|//|url\(|@import", text)
    ids = {attrs["id"] for _, attrs in tags.tags if "id" in attrs}
    links = {attrs["href"] for tag, attrs in tags.tags if tag == "a"}
    assert links <= {f"#{name}" for name in ids}
    assert "prefers-color-scheme: dark" in text
    assert 'name="viewport"' in text
    assert "{{" not in text
    assert "<td>0</td>" not in text  # no rate is rounded to nothing
    for chapter in SHOWN:
        assert chapter().title in tags.text


def small(text="plain", panels=None):
    panels = panels or (Panel("small-one", np.zeros((4, 5), np.uint8), text),)
    timing = Timing("f", text, (4, 5), "uint8", 0.5, 7)

    def figure(clock):
        return Figure(text, f"see `{text}`", text, panels, (timing,))

    return lambda: Chapter("small", text, text, (figure,))


def test_a_chapter_is_one_function(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "index.html").write_text("old")
    tour(tmp_path, chapters=(small("a < b & \"c\" 'd'"), small("two")))
    tags = parse(tmp_path / "index.html")
    assert tags.text.count("a < b & \"c\" 'd'") >= 6
    assert "2.1" in tags.text
    names = sorted(file.name for file in tmp_path.iterdir())
    assert names == ["index.html", "notes.txt", "small-one.webp", "timings.json"]
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_film(tmp_path):
    frames = np.zeros((3, 6, 8, 3), np.uint8)
    frames[1] = 255
    tour(tmp_path, chapters=(small(panels=(Panel("small-film", frames, "a film"),)),))
    with Image.open(tmp_path / "small-film.webp") as film:
        assert film.n_frames == 3
    (image,) = [attrs for tag, attrs in parse(tmp_path / "index.html").tags if tag == "img"]
    assert (image["width"], image["height"]) == ("8", "6")
    assert image["src"] == "small-film.webp"


def test_ink_keeps_every_bit_and_a_photograph_nearly_all(tmp_path):
    ink = np.where(np.random.default_rng(0).random((60, 80)) < 0.1, np.uint8(20), np.uint8(255))
    photo = skimage.data.chelsea()
    panels = (Panel("small-ink", ink, "ink", ink=True), Panel("small-photo", photo, "a cat"))
    tour(tmp_path, chapters=(small(panels=panels),))
    kept = read_image(tmp_path / "small-ink.webp")
    np.testing.assert_array_equal(kept if kept.ndim == 2 else kept[..., 0], ink)
    off = np.abs(read_image(tmp_path / "small-photo.webp").astype(int) - photo)
    assert 0 < off.mean() < 3
    assert (tmp_path / "small-photo.webp").stat().st_size < photo.nbytes / 10


def test_nothing_is_written_when_a_chapter_fails(tmp_path):
    def fail(clock):
        raise ValueError("no such photograph")

    broken = Chapter("broken", "Broken", "It fails.", (fail,))
    with pytest.raises(ValueError, match="photograph"):
        tour(tmp_path / "new", chapters=(small(), lambda: broken))
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way(tmp_path):
    (tmp_path / "tour").write_text("a file")
    with pytest.raises(ValueError, match="folder must be a folder, got the file"):
        tour(tmp_path / "tour", chapters=(small(),))


def test_without_the_photographs(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'cvkern\[demo\]'"):
        tour(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
