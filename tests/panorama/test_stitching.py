"""Heaps of rendered photographs: their groups, and their panoramas."""

import re

import numpy as np
import pytest
import scipy.ndimage as ndi
from skimage import data

import cvkern
from cvkern.panorama import blending, models, registration, stitching
from tests.panorama.scenes import angle_between, bent, photograph, through, turned, wall

SHAPE = 230, 300
# Three views of one sheet, in perspective; each matrix takes the photograph to the view.
VIEWS = [
    np.array([[1.0, 0, -20], [0, 1.0, -60], [0, 0, 1]]),
    np.array([[0.98, 0.05, -170], [-0.04, 1.02, -50], [1e-4, 5e-5, 1]]),
    np.array([[1.03, -0.06, -290], [0.05, 1.0, -90], [5e-5, -5e-5, 1]]),
]


@pytest.fixture(scope="module")
def sheet():
    photo = data.coffee()
    return [through(photo, matrix, SHAPE) for matrix in VIEWS]


@pytest.fixture(scope="module")
def strangers():
    return [data.astronaut()[100:330, 100:400], data.chelsea()[:230, :300]]


@pytest.fixture(scope="module")
def ring():
    """Return photographs all round, and their rotations."""
    focal, count = 210.0, 12
    rng = np.random.default_rng(0)
    picture = wall(focal, 330)
    rotations = [turned(360 * i / count, *rng.normal(0, 2, 2)) for i in range(count)]
    return [photograph(picture, focal, r, focal, (190, 240)) for r in rotations], rotations


def seen_in(panorama, member, image):
    """Return an image drawn on a plane by the panorama's matrix, and where it is."""
    height, width = panorama.mask.shape
    y, x = np.mgrid[:height, :width].astype(float)
    u = panorama.matrices[member] @ np.stack((x, y, np.ones_like(x))).reshape(3, -1)
    middle = (np.array(image.shape[1::-1])[:, None] - 1) / 2
    long = max(image.shape[:2])
    u[:2] = middle + long * bent((u[:2] / u[2] - middle) / long, panorama.lens)
    places = u[1::-1].reshape(2, height, width)
    inside = (places > -0.5).all(axis=0) & (u[2].reshape(height, width) > 0)
    inside &= (places[0] < image.shape[0] - 0.5) & (places[1] < image.shape[1] - 0.5)
    gray = image if image.ndim == 2 else image[..., 0]
    return ndi.map_coordinates(gray.astype(float), places, order=1, mode="nearest"), inside


def test_a_heap(backend, sheet, strangers):
    heap = [strangers[0], sheet[2], sheet[0], strangers[1], sheet[1]]
    components, pairs = cvkern.recognize_panoramas(heap)
    assert components == [[1, 2, 4], [0], [3]]
    assert set(pairs) >= {(1, 4), (2, 4)}
    (panorama,) = cvkern.stitch(heap)
    assert panorama.members == [1, 2, 4]
    assert panorama.surface == "plane"
    assert panorama.pairs == pairs
    assert panorama.image.dtype == np.uint8
    assert panorama.mask.dtype == bool
    matrices = {1: VIEWS[2], 2: VIEWS[0], 4: VIEWS[1]}
    corners = np.array([[0, 0, 1], [299, 0, 1], [299, 229, 1], [0, 229, 1.0]])
    found = dict(zip(panorama.members, panorama.matrices, strict=True))
    for i, j in ((2, 4), (4, 1)):
        got = corners @ (found[j] @ np.linalg.inv(found[i])).T
        want = corners @ (matrices[j] @ np.linalg.inv(matrices[i])).T
        assert np.abs(got[:, :2] / got[:, 2:] - want[:, :2] / want[:, 2:]).max() < 1
    covered = np.zeros(panorama.mask.shape, bool)
    for place, member in enumerate(panorama.members):
        drawn, inside = seen_in(panorama, place, heap[member])
        covered |= inside
        off = np.abs(panorama.image[..., 0].astype(float) - drawn)[inside]
        assert np.median(off) < 2.5
    # The mask ends with the pixels of the images, half a pixel beyond their middles.
    np.testing.assert_array_equal(panorama.mask, covered)
    assert (panorama.image[~panorama.mask] == 0).all()


def test_a_heap_of_little_contrast(sheet, strangers):
    """None of its keypoints has SIFT's contrast."""
    heap = [(90 + 0.1 * image).astype(np.uint8) for image in (sheet[0], strangers[1], sheet[1])]
    assert len(cvkern.sift(heap[0], data_range=255).points) < 10
    assert cvkern.recognize_panoramas(heap) == ([[0, 2], [1]], [(0, 2)])


def test_sets_give_the_same_bits(sheet):
    found = []
    for name in ("warp", "taichi"):
        with cvkern.use(backend=name):
            found += cvkern.stitch([s.astype(np.float32) for s in sheet], data_range=255)
    one, other = found
    np.testing.assert_array_equal(one.image.view(np.uint32), other.image.view(np.uint32))
    np.testing.assert_array_equal(one.mask, other.mask)


def test_a_ring_closes(ring):
    images, rotations = ring
    order = np.random.default_rng(1).permutation(len(images))
    (panorama,) = cvkern.stitch([images[i] for i in order])
    assert panorama.members == list(range(12))
    assert (panorama.model, panorama.surface, panorama.closed) == ("rotation", "cylinder", True)
    assert panorama.image.shape[1] == round(2 * np.pi * np.median(panorama.focal_lengths))
    assert np.abs(panorama.focal_lengths / 210 - 1).max() < 0.005
    for i in range(12):
        for j in range(i):
            got = panorama.rotations[i] @ panorama.rotations[j].T
            want = rotations[order[i]] @ rotations[order[j]].T
            assert angle_between(got, want) < 0.1
    # The two ends fit: they differ no more than neighbouring columns do elsewhere.
    picture = panorama.image.astype(float)
    steps = np.abs(np.diff(picture, axis=1)).mean(axis=0)
    middle = slice(picture.shape[0] // 3, -picture.shape[0] // 3)
    ends = np.abs(picture[middle, 0] - picture[middle, -1]).mean()
    assert ends < 3 * np.quantile(steps, 0.9)


@pytest.mark.parametrize("surface", ["plane", "cylinder", "sphere"])
def test_surfaces_and_focal_lengths(ring, surface):
    images, _ = ring
    given = [200.0, np.nan, 220.0]
    (panorama,) = cvkern.stitch(images[:3], surface=surface, focal_lengths=given, scale=0.7)
    assert panorama.surface == surface
    assert np.abs(panorama.focal_lengths / 210 - 1).max() < 0.02
    assert np.isnan(panorama.matrices).all() == (surface != "plane")
    # The middle of an image is where its rotation says.
    columns = np.arctan2(panorama.rotations[:, 2, 0], panorama.rotations[:, 2, 2])
    assert np.all(np.diff(columns) > np.radians(25))
    assert panorama.mask.mean() > 0.7


@pytest.mark.parametrize("lens", [-0.12, 0.1])
def test_a_lens_that_bends_lines(lens):
    focal, shape = 210.0, (190, 240)
    picture = wall(focal, 330)
    views = [
        photograph(picture, focal, turned(14 * i, 2 * i), focal, shape, lens) for i in range(3)
    ]
    (panorama,) = cvkern.stitch(views, surface="plane", compensate=False)
    assert panorama.model == "rotation"
    assert panorama.lens == pytest.approx(lens, abs=0.015)
    assert panorama.residual < 0.3
    for place, view in enumerate(views):
        drawn, inside = seen_in(panorama, place, view)
        assert np.median(np.abs(panorama.image - drawn)[inside]) < 2
    covered = np.any([seen_in(panorama, i, view)[1] for i, view in enumerate(views)], axis=0)
    np.testing.assert_array_equal(panorama.mask, covered)


def test_strangers_one_and_none(strangers):
    assert cvkern.stitch(strangers) == []
    assert cvkern.stitch(strangers[:1]) == []
    assert cvkern.recognize_panoramas(strangers[:1]) == ([[0]], [])
    flat = [np.zeros((40, 50), np.uint8)] * 3 + [np.zeros((1, 3), np.uint8)]
    assert cvkern.recognize_panoramas(flat) == ([[0], [1], [2], [3]], [])


def test_of_many_images_only_likely_pairs_are_matched(sheet, strangers, monkeypatch):
    heap = [strangers[0], sheet[2], sheet[0], strangers[1], sheet[1]]
    matched = []

    def match(features, pairs, **options):
        matched.append(len(pairs))
        return cvkern.match_images(features, pairs, **options)

    expected = cvkern.recognize_panoramas(heap)
    monkeypatch.setattr(registration, "match_images", match)
    monkeypatch.setattr(registration, "MANY_IMAGES", 4)
    monkeypatch.setattr(registration, "PARTNERS", 2)
    assert cvkern.recognize_panoramas(heap).components == expected.components
    assert matched[0] == 10
    assert matched[1] < 10


def test_duplicates(sheet):
    (panorama,) = cvkern.stitch([sheet[0]] * 3)
    assert panorama.members == [0, 1, 2]
    assert panorama.image.shape == (*SHAPE, 3)
    assert np.abs(panorama.image.astype(int) - sheet[0]).max() <= 1
    assert panorama.mask.all()


def test_turned_images(sheet):
    upright = [np.ascontiguousarray(i) for i in (sheet[0], np.rot90(sheet[1]), sheet[2])]
    (panorama,) = cvkern.stitch(upright)
    (expected,) = cvkern.stitch(sheet)
    assert panorama.members == [0, 1, 2]
    assert sum(panorama.image.shape) == pytest.approx(sum(expected.image.shape), abs=8)


def test_dtypes(sheet):
    (byte,) = cvkern.stitch(sheet[:2])
    (word,) = cvkern.stitch([s.astype(np.uint16) * 257 for s in sheet[:2]])
    assert word.image.dtype == np.uint16
    # Bytes were rounded when they were made small: the seams may lie a pixel apart.
    assert byte.image.shape == word.image.shape
    assert np.median(np.abs(word.image / 257 - byte.image)) < 1
    (real,) = cvkern.stitch([(s / 255).astype(np.float32) for s in sheet[:2]])
    assert real.image.dtype == np.float32
    assert np.median(np.abs(real.image * 255 - byte.image)) < 1
    opaque = [np.dstack((s, np.full(SHAPE, 255, np.uint8))) for s in sheet[:2]]
    (alpha,) = cvkern.stitch(opaque)
    np.testing.assert_array_equal(alpha.image, byte.image)
    gray = [np.ascontiguousarray(s[..., 1]) for s in sheet[:2]]
    (flat,) = cvkern.stitch(gray)
    assert flat.image.ndim == 2
    (mixed,) = cvkern.stitch([gray[0], sheet[1]])
    assert mixed.image.shape[2] == 3
    # Colours win where they are; far from them a grey photograph stays grey.
    seen = [seen_in(mixed, n, image)[1] for n, image in enumerate((gray[0], sheet[1]))]
    spread = np.ptp(mixed.image.astype(int), axis=2)
    away = np.asarray(ndi.distance_transform_edt(~seen[1])) > 60
    assert spread[seen[0] & away].max() <= 1
    drawn = seen_in(mixed, 1, np.ascontiguousarray(sheet[1]))[0]
    both = ndi.binary_erosion(seen[0] & seen[1], iterations=3)
    assert np.median(np.abs(mixed.image[..., 0] / mixed.gains[1, 0] - drawn)[both]) < 2
    assert np.median(spread[both]) > 30


def test_exposures_are_made_alike(sheet):
    dark = [sheet[0], (sheet[1] * 0.6).astype(np.uint8), sheet[2]]
    (panorama,) = cvkern.stitch(dark)
    gains = panorama.gains
    np.testing.assert_allclose(gains[1] / gains[0], 1 / 0.6, rtol=0.04)
    np.testing.assert_allclose(gains[1] / gains[2], 1 / 0.6, rtol=0.04)
    (bare,) = cvkern.stitch(dark, compensate=False)
    assert (bare.gains == 1).all()
    lit = (sheet[1] * 1.8).clip(0, 255).astype(np.uint8)
    assert 0.1 < (lit == 255).mean() < 0.5  # these do not measure the exposure
    (panorama,) = cvkern.stitch([sheet[0], lit, sheet[2]])
    np.testing.assert_allclose(panorama.gains[1] / panorama.gains[[0, 2]], 1 / 1.8, rtol=0.04)


@pytest.mark.parametrize("where", [(60, 20), (110, 60), (150, 130)])
def test_what_moved_is_whole_or_not_there(sheet, where):
    """A red disc, in the first image only, where the second sees the sheet behind it."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    disc = np.hypot(y - where[0], x - 150 - where[1]) < 18
    first = sheet[0].copy()
    first[disc] = 255, 0, 0
    (panorama,) = cvkern.stitch([first, sheet[1]], compensate=False)
    one, inside = seen_in(panorama, 0, np.where(disc, 1.0, 0.0))
    disc = inside & (one > 0.5)
    assert disc.sum() > 500
    red = (panorama.image[..., 0] > 180) & (panorama.image[..., 1] < 90)
    assert not 0.05 < red[disc].mean() < 0.95


def test_tiles_do_not_show(sheet, monkeypatch):
    (whole,) = cvkern.stitch(sheet, bands=3)
    monkeypatch.setitem(blending.TILES, "cpu", 96)
    (tiled,) = cvkern.stitch(sheet, bands=3)
    np.testing.assert_array_equal(whole.mask, tiled.mask)
    # Far from a tile its coarsest band is unknown; the error is below a grey value.
    assert np.abs(whole.image.astype(int) - tiled.image).max() <= 1


def test_without_bands_every_pixel_is_of_one_image(sheet):
    (panorama,) = cvkern.stitch(sheet[:2], bands=0, compensate=False)
    off = []
    for place in range(2):
        drawn, inside = seen_in(panorama, place, sheet[place])
        away = np.abs(panorama.image[..., 0] - drawn)
        off.append(np.where(inside, away, np.inf))
    inner = np.isfinite(off).any(axis=0)
    # Rounding to whole numbers; matrices are those of float64.
    assert np.min(off, axis=0)[inner].max() < 0.51


def test_what_cannot_be_adjusted_is_put_together_with_a_warning(sheet, monkeypatch):
    monkeypatch.setattr(models, "WORST", 1e-3)
    monkeypatch.setattr(models, "SMALL", 1e-3)
    with pytest.warns(UserWarning, match="images 0, 1, 2 could not be adjusted together"):
        (panorama,) = cvkern.stitch(sheet)
    assert panorama.model == "homography tree"
    drawn, inside = seen_in(panorama, 1, sheet[1])
    assert np.median(np.abs(panorama.image[..., 0] - drawn)[inside]) < 3


def test_crop(sheet):
    (whole,) = cvkern.stitch(sheet)
    (cropped,) = cvkern.stitch(sheet, crop=True)
    assert cropped.mask.all()
    assert cropped.mask.size > 0.6 * whole.mask.sum()
    drawn, inside = seen_in(cropped, 0, sheet[0])
    assert np.median(np.abs(cropped.image[..., 0] - drawn)[inside]) < 2.5


def test_progress(sheet):
    said = []
    cvkern.stitch(sheet[:2], progress=lambda *step: said.append(step))
    done, totals, texts = zip(*said, strict=True)
    assert all(a <= b for a, b in zip(done, totals, strict=True))
    assert list(dict.fromkeys(texts)) == [
        "Keypoints", "Matching", "Homographies", "Panorama 1 of 1",
    ]  # fmt: skip


def test_torch_tensors_come_back(sheet):
    torch = pytest.importorskip("torch")
    (panorama,) = cvkern.stitch([torch.from_numpy(s) for s in sheet[:2]])
    (expected,) = cvkern.stitch(sheet[:2])
    assert isinstance(panorama.image, torch.Tensor)
    np.testing.assert_array_equal(panorama.image.numpy(), expected.image)


def test_a_panorama_that_is_too_large_is_refused_before_it_is_drawn(sheet, monkeypatch):
    def drawn(*args):
        raise AssertionError("something was drawn")

    monkeypatch.setattr(stitching, "_drawn", drawn)
    with pytest.raises(ValueError, match="max_pixels must be at least the") as info:
        cvkern.stitch(sheet[:2], max_pixels=50_000)
    said = str(info.value)
    width, height = map(int, re.findall(r"the (\d+) x (\d+) pixels", said)[0])
    assert 430 < width < 480
    assert 220 < height < 270
    assert "of images 0, 1, got 50000: scale makes it smaller, and 0." in said
    with pytest.raises(ValueError, match=r"the panorama of images left\.png, right\.png, got"):
        cvkern.stitch(sheet[:2], max_pixels=50_000, names=["left.png", "right.png"])
