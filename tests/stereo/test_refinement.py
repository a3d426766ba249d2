"""Refinement of disparities, against NumPy pixel by pixel, SciPy, OpenCV and closed forms."""

import cv2
import numpy as np
import pytest

import cvkern
from tests.stereo import reference_refinement as reference

SHAPES = [
    (1, 1),
    (1, 40),
    (37, 1),
    (5, 33),
    (37, 64),
    (331, 401),
]  # the last is for several threads
SMALL = SHAPES[:-1]


def pieces(*shape, seed=0, gaps=0.2):
    """Flat pieces, slopes, noise of half a pixel, and gaps; a fifth of the rows have nothing."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    level = rng.integers(0, 9, (shape[0] // 6 + 1, shape[1] // 6 + 1))[y // 6, x // 6]
    values = level + rng.integers(0, 3, shape) / 2 + 0.01 * x
    values[rng.random(shape) < gaps] = np.nan
    values[: shape[0] // 5] = np.nan
    return values.astype(np.float32)


def shades(*shape, seed=0):
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < 0.5, 90, rng.integers(0, 256, shape)).astype(np.uint8)


# --- the check from the right --------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("tolerance", [0, 0.5, 2])
def test_check(backend, shape, tolerance):
    disparity, right = pieces(*shape), pieces(*shape, seed=1)
    for sign in (1, -1):
        got = cvkern.left_right_check(sign * disparity, sign * right, tolerance=tolerance)
        assert got.dtype == np.float32
        want = reference.left_right(sign * disparity, sign * right, np.float32(tolerance))
        np.testing.assert_array_equal(got, want)


def test_check_finds_what_one_camera_sees(backend):
    """A square at disparity 6 before a wall at 2: four columns to its left are hidden."""
    left, right = np.full((2, 9, 30), 2.0)
    left[2:7, 14:20] = 6
    right[2:7, 8:14] = 6
    kept = np.isfinite(cvkern.left_right_check(left, right))
    want = np.ones(left.shape, bool)
    want[:, :2] = False  # not in the right image
    want[2:7, 10:14] = False
    np.testing.assert_array_equal(kept, want)


# --- speckles ------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("min_size", "difference"), [(1, 0.0), (2, 0.5), (9, 0.5), (40, 1.5)])
def test_speckles(backend, shape, min_size, difference):
    disparity = pieces(*shape)
    got = cvkern.remove_speckles(disparity, min_size, difference=difference)
    want = reference.remove_speckles(disparity, min_size, difference)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("seed", range(3))
def test_speckles_are_those_of_opencv(backend, seed):
    rng = np.random.default_rng(seed)
    disparity = rng.integers(0, 4, (150, 211)).astype(np.int16)
    got = cvkern.remove_speckles(disparity, 12, difference=1)
    peer = disparity.copy()
    cv2.filterSpeckles(peer, -1, 11, 1)  # up to a size, and in place
    assert 0.02 < np.isnan(got).mean() < 0.98
    np.testing.assert_array_equal(np.where(np.isnan(got), -1, got), peer)


def test_a_region_that_winds_through_all_slabs(backend):
    """A spiral, which union-find must follow all along, beside parts that it separates."""
    n = 400
    spiral = np.zeros((n + 1, n), np.float32)
    for t in range(0, n // 2, 4):
        spiral[t, t : n - t] = spiral[t : n + 1 - t, n - 1 - t] = 9
        spiral[n - t, t : n - t] = spiral[t + 4 : n + 1 - t, t] = 9
        spiral[t + 4, t : t + 5] = 9
    got = cvkern.remove_speckles(spiral, 10**4, difference=0)
    np.testing.assert_array_equal(got, reference.remove_speckles(spiral, 10**4, 0))
    assert np.isfinite(got[spiral == 9]).all()


# --- gaps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("gaps", [0.0, 0.3, 0.95, 1.0])
def test_fill(backend, shape, gaps):
    disparity = pieces(*shape, gaps=gaps)
    got = cvkern.fill_disparity(disparity)
    np.testing.assert_array_equal(got, reference.fill(disparity)[0])


def test_fill_takes_infinities_for_gaps(backend):
    got = cvkern.fill_disparity([[np.inf, 4, -np.inf, 3, np.nan]])
    np.testing.assert_array_equal(got, [[4, 4, 3, 3, 3]])


# --- the median ----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SMALL)
@pytest.mark.parametrize("radius", [0, 1, 6, 15])
@pytest.mark.parametrize("contrast", [1, 40, 300])
def test_guided_median(backend, shape, radius, contrast):
    disparity, guide = pieces(*shape), shades(*shape)
    got = cvkern.guided_median(disparity, guide, radius, contrast=contrast)
    want = reference.guided_median(disparity, guide, radius, contrast)
    np.testing.assert_array_equal(got, want)


def test_guided_median_of_a_large_map(backend):
    """Several threads; without contrast the plain median, along and then down."""
    disparity = pieces(230, 301, gaps=0)[46:]
    got = cvkern.guided_median(disparity, shades(*disparity.shape), 3, contrast=1)
    want = disparity
    for axis in (1, 0):
        pad = [(0, 0), (0, 0)]
        pad[axis] = (3, 3)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(want, pad, "edge"), 7, axis)
        want = np.median(windows, axis=-1)
    np.testing.assert_array_equal(got, want)


def test_edges_follow_the_image(backend):
    """An object seven pixels too fat, as windows make them, gets its outline back."""
    image = np.full((60, 70), 60, np.uint8)
    image[20:40, 25:45] = 180
    fat = np.where(cv2.dilate(image, np.ones((7, 7), np.uint8)) > 100, 9.0, 2.0)
    got = cvkern.guided_median(fat, image, 6, contrast=40)
    np.testing.assert_array_equal(got[image > 100], 9)
    assert (got != np.where(image > 100, 9, 2)).sum() <= 4 * 9  # nothing but at the corners


# --- what all have in common ---------------------------------------------------------------------

CALLS = {
    "left_right_check": lambda x: cvkern.left_right_check(x, x),
    "remove_speckles": lambda x: cvkern.remove_speckles(x, 5),
    "fill_disparity": cvkern.fill_disparity,
    "guided_median": lambda x: cvkern.guided_median(x, np.zeros(x.shape, np.uint8), 2),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "float64"])
def test_dtypes(backend, name, dtype):
    disparity = np.random.default_rng(0).integers(0, 9, (20, 30)).astype(dtype)
    kept = disparity.copy()
    got = CALLS[name](disparity)
    assert got.dtype == np.float32
    np.testing.assert_array_equal(got, CALLS[name](disparity.astype(np.float32)))
    np.testing.assert_array_equal(disparity, kept)


@pytest.mark.parametrize("name", CALLS)
def test_nothing_stays_nothing(backend, name):
    got = CALLS[name](np.full((7, 9), np.nan, np.float32))
    assert np.isnan(got).all()


@pytest.mark.parametrize("shape", [(2**20, 1), (1, 2**20), (2**17, 3)])
def test_gaps_of_very_long_images_are_filled_in_time(backend, shape):
    """Nearly all rows are empty: the search for a full one must not begin anew at each."""
    disparity = np.full(shape, np.nan, np.float32)
    flat = disparity.reshape(-1)
    flat[flat.size // 2], flat[flat.size * 3 // 4] = 3, 5
    filled = cvkern.fill_disparity(disparity)
    filled = filled[0] if isinstance(filled, tuple) else filled
    if shape[0] == 1:
        want = np.where(np.arange(shape[1]) > shape[1] * 3 // 4 - 1, 5, 3)
        np.testing.assert_array_equal(filled[0], want)
    else:
        want = np.where(np.arange(shape[0]) < 3 * shape[0] // 4, 3, 5)
        np.testing.assert_array_equal(filled, np.repeat(want[:, None], shape[1], axis=1))
