"""ORB against a NumPy statement of its steps, and against OpenCV's FAST and bits."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.data
from PIL import Image
from skimage.feature.orb_cy import _orb_loop

import cvkern
from cvkern._runtime import KERNEL_SETS, runtime
from cvkern.features._choice import best
from cvkern.features.binary import EDGE, pattern, sizes_of

CAMERA = skimage.data.camera()[100:260, 150:350]


def strongest(image, points):
    """State Harris' measure over 7 x 7 pixels, times 25, in integers."""
    wide = image.astype(np.int64)
    dy, dx = (ndi.sobel(wide, axis=a) for a in (0, 1))
    yy, xx, xy = (
        np.array([p[y - 3 : y + 4, x - 3 : x + 4].sum() for y, x in points])
        for p in (dy * dy, dx * dx, dy * dx)
    )
    return 25 * (yy * xx - xy * xy) - (yy + xx) ** 2


def test_points_are_opencvs_corners(backend):
    """All of a level without a budget: FAST of 9 of 16 pixels, maxima of 3 x 3."""
    found = cvkern.orb(CAMERA, None, levels=1, fast_threshold=20 / 255)
    detector = cv2.FastFeatureDetector.create(20, True)
    want = np.array([p.pt[::-1] for p in detector.detect(CAMERA)])
    inner = (want >= EDGE).all(axis=1) & (want < np.array(CAMERA.shape) - EDGE).all(axis=1)
    ours = {tuple(p) for p in found.points.astype(int).tolist()}
    theirs = {tuple(p) for p in want[inner].astype(int).tolist()}
    assert len(theirs) > 50
    # Equal neighbours: OpenCV keeps none of them, we the first.
    assert theirs <= ours
    assert len(ours) < 1.1 * len(theirs)


def test_measure_direction_and_bits(backend):
    found = cvkern.orb(CAMERA, 80, levels=1)
    points = found.points.astype(int)
    full = 25 * (49 * 1020.0**2) ** 2
    want = strongest(CAMERA, points) / full
    np.testing.assert_allclose(found.responses, want, rtol=1e-6)
    i, j = np.mgrid[-15:16, -15:16]
    disc = i * i + j * j <= 15 * 16
    smooth = cv2.GaussianBlur(CAMERA, (7, 7), 2).astype(int)
    for n, (y, x) in enumerate(points):
        window = CAMERA[y - 15 : y + 16, x - 15 : x + 16] * disc
        angle = np.arctan2((i * window).sum(), (j * window).sum())
        assert abs(found.orientations[n] - angle) < 1e-6
        turn = int(np.floor(angle * 64 / (2 * np.pi) + 0.5)) % 64
        rows = (pattern()[turn] + 32) // 64
        values = smooth[y + rows, x + pattern()[turn] - 64 * rows]
        bits = np.packbits(values[:, 0] < values[:, 1], bitorder="little")
        np.testing.assert_array_equal(bits, found.descriptors[n])


def test_bits_are_opencvs(backend):
    """At the same points: a place may be rounded to another pixel, more so by another turn."""
    found = cvkern.orb(CAMERA, None, levels=1)
    turns = found.orientations.astype(float) % (2 * np.pi) * 64 / (2 * np.pi)
    peer = cv2.ORB.create(500, nlevels=1, edgeThreshold=EDGE)
    for steps, share in ((np.floor(turns + 0.5) % 64, 0.003), (turns, 0.05)):
        places = zip(found.points.tolist(), steps.tolist(), strict=True)
        points = [cv2.KeyPoint(x, y, 31, step * 360 / 64, 0, 0) for (y, x), step in places]
        points, bits = peer.compute(CAMERA, points)
        assert len(points) == len(found.points)
        assert np.unpackbits(bits ^ found.descriptors).mean() < share


def test_pairs_are_those_of_scikit_image():
    """Its loop over the pairs, on the same smoothed image, gives the same bits."""
    found = cvkern.orb(CAMERA, 60, levels=1)
    steps = np.floor(found.orientations.astype(float) * 64 / (2 * np.pi) + 0.5)
    smooth = cv2.GaussianBlur(CAMERA, (7, 7), 2).astype(float)
    bits = _orb_loop(smooth, found.points.astype(np.intp), steps * 2 * np.pi / 64)
    want = np.packbits(np.asarray(bits) > 0, axis=1, bitorder="little")
    np.testing.assert_array_equal(found.descriptors, want)


@pytest.mark.parametrize(
    ("side", "downscale"), [((160, 200), 1.2), ((300, 420), 3.1), ((90, 330), 1.3)]
)
def test_smaller_sizes_are_pillows(backend, side, downscale):
    """Pillow's weights are finer: both passes may round to the next byte."""
    image = np.ascontiguousarray(skimage.data.camera()[: side[0], : side[1]])
    sides, starts, weights = sizes_of(*side, 3, downscale)
    assert len(sides) > 1
    made = [image, *(np.empty(shape, np.uint8) for shape in sides[1:])]
    rt = runtime(image)
    given = [rt.adopt(a, np.uint8) for a in made]
    rt.features.binary.shrink(given, rt.constant(starts), rt.constant(weights))
    for before, after in pairwise(made):
        want = Image.fromarray(before).resize(after.shape[::-1], Image.Resampling.BILINEAR)
        assert np.abs(np.asarray(want).astype(int) - after).max() <= 2


def test_scales_are_those_of_both_sides():
    """The sides of each size are rounded: 83 x 200 becomes 69 x 167."""
    found = np.unique(cvkern.orb(CAMERA[:83, :200], None, levels=2).scales)
    want = [1, np.sqrt(83 / 69 * 200 / 167)]
    np.testing.assert_allclose(found / found[0], want, rtol=1e-6)


def test_a_budget_keeps_the_strongest(backend):
    every = cvkern.orb(CAMERA, None, levels=1)
    some = cvkern.orb(CAMERA, 40, levels=1)
    kept = np.sort(np.argsort(-strongest(CAMERA, every.points.astype(int)), kind="stable")[:40])
    for a, b in zip(some, every, strict=True):
        np.testing.assert_array_equal(a, b[kept])
    assert len(cvkern.orb(CAMERA, 0).points) == 0


def test_the_best_of_many_are_found():
    """Maxima of groups bound the least response that is kept; ties are many."""
    responses = np.random.default_rng(5).integers(0, 300, 5003)
    for count in (1, 20, 312, 2000):
        order = np.argsort(-responses, kind="stable")[:count]
        chosen = best(responses, np.empty((5003, 2)), (9, 9), count, spread=False)
        np.testing.assert_array_equal(chosen, np.sort(order))


def test_sets_and_runs_give_the_same_bits():
    for options in ({}, {"spread": True, "max_keypoints": 60, "upright": True},
                    {"mask": CAMERA > 60, "levels": 3}):  # fmt: skip
        found = []
        for name in (*KERNEL_SETS, KERNEL_SETS[0]):
            with cvkern.use(backend=name):
                found.append(cvkern.orb(CAMERA, **options))
        for a, b, c in zip(*found, strict=True):
            np.testing.assert_array_equal(a, b)
            np.testing.assert_array_equal(a, c)


@pytest.mark.parametrize("find", [cvkern.orb, cvkern.sift])
def test_threads_do_not_show(find, monkeypatch):
    """Rows are cut into slabs, and levels into blocks of pixels that end within a row."""
    image = skimage.data.camera()[:301, :457]
    found = []
    for threads in ("1", "3"):
        monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
        with cvkern.use(backend="warp"):
            found.append(find(image, 200))
    assert len(found[0].points) == 200
    for a, b in zip(*found, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_turned_photograph_is_found_again(backend):
    turned = np.ascontiguousarray(np.rot90(CAMERA))
    one, other = (cvkern.orb(i, 150) for i in (CAMERA, turned))
    matches = cvkern.match_descriptors(one.descriptors, other.descriptors, metric="hamming")
    row, column = one.points[matches[:, 0]].T
    where = np.stack((CAMERA.shape[1] - 1 - column, row), axis=1)
    right = np.abs(where - other.points[matches[:, 1]]).max(axis=1) < 3
    assert right.sum() > 75


def test_small_and_empty_images(backend):
    for shape in ((1, 1), (38, 100), (50, 60)):
        found = cvkern.orb(np.zeros(shape))
        assert [len(f) for f in found] == [0] * 5
        assert found.descriptors.shape == (0, 32)


def test_the_pattern_stays():
    """What was described once can be matched later: the first pairs, and a weighted sum of all."""
    places = pattern().astype(int)
    assert places.shape == (64, 256, 2)
    rows = (places + 32) // 64
    columns = places - 64 * rows
    assert max(np.abs(rows).max(), np.abs(columns).max()) == 18
    assert (rows[0, 0].tolist(), columns[0, 0].tolist()) == ([-3, 5], [8, 9])
    assert (places.ravel() * (np.arange(places.size) % 997)).sum() == 19279952
    # (row, column) by 90 degrees is (column, -row): upright places are whole pixels.
    np.testing.assert_array_equal(rows[16], columns[0])
    np.testing.assert_array_equal(columns[16], -rows[0])


@pytest.mark.parametrize("downscale", [1.0, 4.5])
def test_refusals(no_kernel_runs, downscale):
    with pytest.raises(ValueError, match="downscale must be above 1 and at most 4, got"):
        cvkern.orb(CAMERA, downscale=downscale)
