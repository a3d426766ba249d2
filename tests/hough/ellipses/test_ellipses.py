"""Votes for ellipses against float64, and ellipses in pictures with known truth."""

import numpy as np
import pytest
import scipy.ndimage
import skimage.data
import skimage.draw
import skimage.transform

import cvkern
import cvkern.images
from cvkern._runtime import KERNEL_SETS
from tests.hough.circles.reference_circles import ellipse
from tests.hough.ellipses import reference_ellipses as reference


def drawn(shape, row, column, major, minor, turn):
    """Pixels along an ellipse, one at least for each of its pixels."""
    t = np.linspace(0, 2 * np.pi, 2000)
    u, v = major * np.cos(t), minor * np.sin(t)
    y, x = row + u * np.sin(turn) + v * np.cos(turn), column + u * np.cos(turn) - v * np.sin(turn)
    mask = np.zeros(shape, bool)
    mask[np.rint(y).astype(int), np.rint(x).astype(int)] = True
    return mask


def turned(one, other):
    """The angle between two axes."""
    gap = np.abs(one - other) % np.pi
    return np.minimum(gap, np.pi - gap)


# --- hough_ellipse -------------------------------------------------------------------------------


@pytest.mark.parametrize("accuracy", [1.0, 2.5, 20.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_votes_are_those_of_float64(backend, accuracy, seed):
    mask = np.random.default_rng(seed).random((23, 31)) < 0.05
    found = cvkern.hough_ellipse(mask, 0, accuracy, min_size=6)
    pixels = np.argwhere(mask)
    want = {}
    for i in range(len(pixels)):
        for j in range(i):
            if np.linalg.norm(pixels[i] - pixels[j]) >= 6:
                counts, gap = reference.votes_of(pixels, i, j, accuracy, 11.5)
                if counts.max() > 0:
                    want[i, j] = (counts, gap)
    assert len(found.votes) == len(want)
    assert len(want) > 100
    ends = {}
    for n in range(len(found.votes)):
        major, (row, column) = found.axes[n, 0], found.centers[n]
        step = major * np.array([np.sin(found.orientation[n]), np.cos(found.orientation[n])])
        both = sorted(tuple(np.rint((row, column) + s * step).astype(int)) for s in (1, -1))
        ends[tuple(both)] = n
    certain = 0
    for (i, j), (counts, gap) in want.items():
        n = ends[tuple(sorted((tuple(pixels[i]), tuple(pixels[j]))))]
        if gap < 1e-5:  # a tie that float32 may round either way
            continue
        certain += 1
        assert found.votes[n] == counts.max()
        major = np.linalg.norm(pixels[i] - pixels[j]) / 2
        want_minor = min(np.argmax(counts) * accuracy, major)
        np.testing.assert_allclose(found.axes[n], (major, want_minor), rtol=1e-6)
    assert certain > 0.5 * len(want)


ELLIPSES = [
    (30, 40, 28, 12, 0.0),
    (40, 30, 28, 12, 1.2),
    (33, 42, 25, 20, -0.7),
    (40, 40, 20, 19, 0.3),
]


@pytest.mark.parametrize("one", ELLIPSES)
def test_an_ellipse_among_specks(backend, one):
    row, column, major, minor, turn = one
    rng = np.random.default_rng(0)
    mask = drawn((80, 80), *one)
    total = mask.sum()
    mask &= rng.random(mask.shape) < 0.9
    mask |= rng.random(mask.shape) < 0.01
    found = cvkern.hough_ellipse(mask, int(total / 4), 2.0, min_size=30)
    assert len(found.votes) > 0
    assert (np.diff(found.votes) <= 0).all()
    # Pixels are off by up to half of one, at the ends of the axis too.
    assert np.abs(found.centers[0] - (row, column)).max() <= 1.5
    assert np.abs(found.axes[0] - (major, minor)).max() <= 2.5
    assert major - minor < 2 or turned(found.orientation[0], turn) < 0.1


def test_what_scikit_image_finds_is_found(backend):
    """Its own example."""
    mask = np.zeros((25, 25), np.uint8)
    rr, cc = skimage.draw.ellipse_perimeter(10, 10, 6, 8)
    mask[cc, rr] = 1
    found = cvkern.hough_ellipse(mask, threshold=8)
    assert found.centers[0].tolist() == [10, 10]
    assert found.axes[0].tolist() == [8, 6]
    assert found.orientation[0] == pytest.approx(np.pi / 2)  # `cc` are the rows


def test_directions_leave_the_right_votes(backend):
    one = (40.0, 60.0, 35.0, 18.0, 0.5)
    image = 100 * ellipse((80, 120), *one) + np.random.default_rng(0).normal(0, 4, (80, 120))
    mask = cvkern.canny(image, 1.5, 24, 64)
    angles = cvkern.gradient(image, sigma=1.5).orientation
    plain = cvkern.hough_ellipse(mask, 15, 2.0, 20)
    directed = cvkern.hough_ellipse(mask, 15, 2.0, 20, orientation=angles)
    assert 0 < len(directed.votes) < 0.2 * len(plain.votes)
    assert np.abs(directed.centers[0] - one[:2]).max() < 1.5
    assert np.abs(directed.axes[0] - one[2:4]).max() < 2.5
    assert turned(directed.orientation[0], one[4]) < 0.05


def test_masks_with_too_few_pixels(backend):
    for count in range(4):
        mask = np.zeros((20, 30))
        mask[5, :count] = mask[15, :0] = 1
        found = cvkern.hough_ellipse(mask, 0)
        assert [a.shape for a in found] == [(0,), (0, 2), (0, 2), (0,)]


def test_a_line_is_no_ellipse(backend):
    found = cvkern.hough_ellipse(np.eye(30), 0)
    assert len(found.votes) == 0


@pytest.mark.parametrize("directed", [False, True])
def test_the_kernel_sets_agree_in_every_bit(directed):
    photo = skimage.data.coffee()[::2, ::2].mean(axis=2).astype(np.float32)
    mask = cvkern.canny(photo, 2, 96, 160)
    angles = cvkern.gradient(photo, sigma=2).orientation if directed else None
    answers = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            answers.append(cvkern.hough_ellipse(mask, 10, 2.0, 40, orientation=angles))
    for a, b in zip(*answers, strict=True):
        np.testing.assert_array_equal(a.view(np.uint32), b.view(np.uint32))
    assert len(answers[0].votes) > 100


@pytest.mark.parametrize("threads", ["1", "2", "5"])
def test_threads_do_not_show(threads, monkeypatch):
    mask = np.random.default_rng(3).random((60, 70)) < 0.05
    want = cvkern.hough_ellipse(mask, 3)
    monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
    for a, b in zip(cvkern.hough_ellipse(mask, 3), want, strict=True):
        np.testing.assert_array_equal(a, b)


# --- detect_ellipses -----------------------------------------------------------------------------

SCENE = [(80, 100, 60, 30, 0.4, 110), (200, 280, 80, 45, -1.0, -60), (90, 300, 40, 38, 0.0, 70),
         (220, 90, 70, 25, 1.3, 60)]  # fmt: skip


def scene(sigma=8.0, scale=1.0):
    shape = round(300 * scale), round(400 * scale)
    image = 90.0 + np.random.default_rng(1).normal(0, sigma, shape)
    for row, column, major, minor, turn, gain in SCENE:
        y, x, a, b = (scale * size for size in (row, column, major, minor))
        image += gain * ellipse(shape, y, x, a, b, turn)
    return image


def assert_found(found, within, scale=1.0):
    """One ellipse to one of the scene, within twice what was measured, and no other."""
    assert len(found.support) == len(SCENE)
    assert (np.diff(found.support) <= 0).all()
    for row, column, major, minor, turn, _ in SCENE:
        n = np.hypot(*(found.centers - (scale * row, scale * column)).T).argmin()
        assert np.abs(found.centers[n] - (scale * row, scale * column)).max() <= within
        assert np.abs(found.axes[n] - (scale * major, scale * minor)).max() <= within
        assert major - minor < 5 or turned(found.orientation[n], turn) <= 0.0044


def test_ellipses_are_found_to_a_fraction_of_a_pixel(backend):
    found = cvkern.detect_ellipses(scene().clip(0, 255).astype(np.uint8), (15, 100))
    assert [a.shape for a in found] == [(4, 2), (4, 2), (4,), (4,)]
    assert all(a.dtype == np.float32 for a in found)
    assert_found(found, 0.37)


def test_blur_does_not_shorten_an_ellipse(backend):
    """Where it bends most, its blurred edge lies 0.4 pixels inside; the axes make up for that."""
    image = 90 + 100 * ellipse((120, 140), 60.3, 70.2, 30, 12, 1.0)
    found = cvkern.detect_ellipses(image.astype(np.uint8), (8, 60))
    np.testing.assert_allclose(found.axes, [[30, 12]], rtol=0, atol=0.09)  # twice what was measured
    np.testing.assert_allclose(found.centers, [[60.3, 70.2]], rtol=0, atol=0.13)


def test_ellipses_partly_hidden(backend):
    image = scene()
    image[170:215, 300:400] = 90  # beside the second, not at an end of its major axis
    image[50:110, 85:115] = 90  # through the middle of the first
    found = cvkern.detect_ellipses(image.clip(0, 255).astype(np.uint8), (15, 100))
    assert_found(found, 0.55)


def test_large_pictures_are_reduced(backend):
    image = scene(scale=3).clip(0, 255).astype(np.uint8)
    assert_found(cvkern.detect_ellipses(image, (60, 300)), 1.5, 3)


def test_noise_is_no_ellipse(backend):
    for seed in range(2):
        image = np.random.default_rng(seed).normal(100, 20, (120, 160)).clip(0, 255)
        found = cvkern.detect_ellipses(image.astype(np.uint8), (10, 60), max_points=500)
        assert [a.shape for a in found] == [(0, 2), (0, 2), (0,), (0,)]


def test_nothing_is_found_in_nothing(backend):
    found = cvkern.detect_ellipses(np.full((40, 50), 7.0), (4, 20))
    assert [a.shape for a in found] == [(0, 2), (0, 2), (0,), (0,)]


def test_the_rim_of_a_cup(backend):
    """The outer rim, read off the photograph."""
    gray = cvkern.images.luma(skimage.data.coffee()).round().astype(np.uint8)
    found = cvkern.detect_ellipses(gray, (85, 200))
    best = found.centers[0], found.axes[0]
    np.testing.assert_allclose(best[0], (113, 290), atol=5)
    np.testing.assert_allclose(best[1], (117, 95), atol=6)


def test_the_photograph_is_not_needed_as_numpy(backend):
    torch = pytest.importorskip("torch")
    image = scene().clip(0, 255).astype(np.uint8)
    found = cvkern.detect_ellipses(torch.from_numpy(image), (15, 100))
    assert all(isinstance(a, torch.Tensor) for a in found)
    for a, b in zip(found, cvkern.detect_ellipses(image, (15, 100)), strict=True):
        np.testing.assert_array_equal(a.numpy(), b)


@pytest.mark.parametrize("turn", [0.0, 0.5, 1.2, -0.7, np.pi / 2])
def test_the_table_draws_the_ellipse(backend, turn):
    """Scikit-image's fields, which its function for drawing takes."""
    found = cvkern.hough_ellipse(drawn((80, 90), 40, 44, 30, 14, turn), threshold=40)
    table = found.table()
    disc = drawn((12, 12), 6, 6, 4, 3, 0)
    assert table.dtype == skimage.transform.hough_ellipse(disc, threshold=1, accuracy=2).dtype
    assert len(table) == len(found.votes) > 0
    np.testing.assert_array_equal(table["accumulator"], found.votes)
    assert (table["orientation"] >= 0).all()
    assert (table["orientation"] < np.pi).all()
    _, row, column, major, minor, orientation = table[0].tolist()
    sides = (round(v) for v in (row, column, major, minor))
    rows, columns = skimage.draw.ellipse_perimeter(*sides, orientation=orientation)
    near = drawn((80, 90), 40, 44, 30, 14, turn)
    away = np.asarray(scipy.ndimage.distance_transform_edt(~near))
    assert (
        away[rows, columns].max() <= 2.5
    )  # whole pixels of the centre and the axes, and half a degree


def test_the_table_of_nothing_is_empty(backend):
    assert len(cvkern.hough_ellipse(np.zeros((9, 9)), 4).table()) == 0
