"""Canny against OpenCV, a float64 Canny and scikit-image, and properties of all edges."""

from typing import Any

import cv2
import numpy as np
import pytest
import skimage.data
import skimage.feature
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.calls import DTYPES, MODES, blobs, layouts, noise
from tests.edges import reference_canny as reference

pytestmark = pytest.mark.filterwarnings("ignore:no edge was found")
NORMS = ["l1", "l2"]
PHOTOGRAPHS = ["camera", "coins", "moon", "page", "text"]


def opencv(image, low, high, norm):
    # OpenCV turns an infinite threshold into the least integer under L1: nothing exceeds this one.
    low, high = min(low, 32767), min(high, 32767)
    return cv2.Canny(image, low, high, L2gradient=norm == "l2") > 0


def as_opencv(image, low, high, norm):
    return cvkern.canny(image, 0, low, high, suppression="sectors", norm=norm, mode="nearest")


# --- OpenCV's edges, every pixel of them ---------------------------------------------------------


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_photographs_are_opencvs(backend, name, norm):
    image = getattr(skimage.data, name)()[:300, :301]
    for low, high in ((50, 150), (100, 200), (20, 21)):
        want = opencv(image, low, high, norm)
        assert want.any()
        np.testing.assert_array_equal(as_opencv(image, low, high, norm), want)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("levels", [2, 3, 8, 256])
def test_every_size_is_opencvs(backend, levels, norm):
    """Each width and each height from 1 to 70; few levels make many ties."""
    rng = np.random.default_rng(levels)
    for side in range(1, 71):
        for shape in ((side, 1 + side * 37 % 70), (1 + side * 37 % 70, side)):
            image = (rng.integers(0, levels, shape) * (255 // (levels - 1))).astype(np.uint8)
            low, high = sorted(rng.integers(0, 1100, 2).tolist())
            np.testing.assert_array_equal(
                as_opencv(image, low, high, norm), opencv(image, low, high, norm)
            )


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize(
    ("low", "high"),
    [
        (0, 0), (0, 100), (0.5, 0.5), (99.5, 200.25), (100, 100), (1020, 1442.5), (1e-9, 2040),
        (50, np.inf), (np.inf, np.inf), (32767, 32767), (1e9, 1e300), (3000, 4000),
    ],
)  # fmt: skip
def test_every_threshold_is_opencvs(backend, low, high, norm):
    for image in (noise(40, 61, dtype="uint8"), blobs(40, 61), 255 * noise(40, 61, dtype="bool")):
        image = image.astype(np.uint8)
        want = opencv(image, low, high, norm)
        np.testing.assert_array_equal(as_opencv(image, low, high, norm), want)


@given(
    shape=st.tuples(st.integers(1, 70), st.integers(1, 70)),
    limits=st.tuples(st.floats(0, 1500), st.floats(0, 1500)),
    norm=st.sampled_from(NORMS),
    seed=st.integers(0, 2**16),
)
def test_any_blobs_are_opencvs(backend, shape, limits, norm, seed):
    image, (low, high) = blobs(*shape, seed=seed), sorted(limits)
    np.testing.assert_array_equal(as_opencv(image, low, high, norm), opencv(image, low, high, norm))


@pytest.mark.parametrize("threads", ["1", "2", "3", "7"])
def test_edges_run_on_across_the_slabs_of_threads(backend, threads, monkeypatch):
    """A weak spiral through the whole picture, strong at its inner end alone."""
    monkeypatch.setenv("CVKERN_NUM_THREADS", threads)  # Taichi reads it once, Warp at each call
    image = np.zeros((600, 700), np.uint8)
    turns = np.linspace(0, 2 * np.pi * 25, 9000)
    spiral = np.stack([np.cos(turns), np.sin(turns)], 1) * np.linspace(5, 290, 9000)[:, None]
    cv2.polylines(image, [(spiral + 300).round().astype(np.int32)], False, 40, 2)
    image[299:303, 303:308] = 255
    want = opencv(image, 60, 600, "l1")
    assert want.sum() > 10_000
    for turned in (image, image[::-1].copy()):
        want = opencv(turned, 60, 600, "l1")
        np.testing.assert_array_equal(as_opencv(turned, 60, 600, "l1"), want)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("mode", MODES)
def test_integers_give_the_edges_of_equal_floats(backend, mode, norm):
    """uint8 under Sobel has kernels of its own; both are exact for integers."""
    for image in (blobs(37, 53), blobs(1, 40), blobs(40, 1), blobs(3, 2)):
        options = {"suppression": "sectors", "norm": norm, "mode": mode, "cval": 200}
        got = cvkern.canny(image, 0, 60, 150, **options)
        for dtype in ("float32", "int32"):
            other = cvkern.canny(image.astype(dtype), 0, 60, 150, **options)
            np.testing.assert_array_equal(got, other)


# --- the operator 'gaussian' against float64 -----------------------------------------------------

PLAIN = [mode for mode in MODES if mode != "constant"]  # the constant border is divided by weights
GAIN = 8  # thresholds are in the units of Sobel's kernels


def gaussian_canny(image, sigma, low, high, **options):
    return cvkern.canny(image, sigma, GAIN * low, GAIN * high, operator="gaussian", **options)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("mode", PLAIN)
@pytest.mark.parametrize("sigma", [0.6, 1.0, 2.5])
@pytest.mark.parametrize("shape", [(1, 60), (60, 1), (5, 4), (47, 71)])
def test_gaussian_canny_is_that_of_float64(backend, shape, sigma, mode, norm):
    image = blobs(*shape)
    low, high = 2.0, 7.0
    got = gaussian_canny(image, sigma, low, high, norm=norm, mode=mode, cval=30)
    want = reference.canny(image, sigma, low, high, norm, mode, cval=30)
    assert got.dtype == bool
    assert not (want.certain & ~got).any()
    assert not (got & ~want.possible).any()
    # Few, or this would say nothing; a tie leaves two pixels in doubt.
    assert (want.certain != want.possible).sum() <= 2 + 0.01 * image.size


@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 70)),
    sigma=st.floats(0.5, 3),
    limits=st.tuples(st.floats(0.01, 0.3), st.floats(0.01, 0.3)),
    norm=st.sampled_from(NORMS),
    mode=st.sampled_from(PLAIN),
    seed=st.integers(0, 2**16),
)
def test_gaussian_canny_of_noise(backend, shape, sigma, limits, norm, mode, seed):
    image, (low, high) = noise(*shape, seed=seed), sorted(limits)
    got = gaussian_canny(image, sigma, low, high, norm=norm, mode=mode)
    want = reference.canny(image, sigma, low, high, norm, mode)
    assert not (want.certain & ~got).any()
    assert not (got & ~want.possible).any()


@pytest.mark.parametrize("norm", NORMS)
def test_of_two_equal_maxima_the_first_is_kept(backend, norm):
    """Beside a step between two columns both have the same gradient, bit for bit."""
    step = np.repeat([0.0, 1.0], 8)[None].repeat(9, 0)
    for image in (step, step[:, ::-1], step.T, step[:, ::-1].T):
        got = cvkern.canny(image, 1.3, norm=norm, mode="nearest", operator="gaussian")
        want = np.zeros_like(got)
        want[(slice(None), 7) if image.shape == step.shape else 7] = True
        np.testing.assert_array_equal(got, want)


def test_thresholds_by_quantiles(backend):
    """The operators that scikit-image does not have: a length must exceed the quantile."""
    image = blobs(40, 60)
    for operator, norm, low, high in (("gaussian", "l2", 0.7, 0.9), ("gaussian", "l1", 0, 1 / 3)):
        g = cvkern.gradient(image, sigma=1.5)
        dy, dx = 8 * g.dy, 8 * g.dx
        length = np.abs(dy) + np.abs(dx) if norm == "l1" else np.sqrt(dx * dx + dy * dy)
        options: dict[str, Any] = {"operator": operator, "norm": norm, "mode": "reflect"}
        got = cvkern.canny(image, 1.5, low, high, use_quantiles=True, **options)
        limits = np.quantile(length.astype(np.float64), [low, high])
        np.testing.assert_array_equal(got, cvkern.canny(image, 1.5, *limits, **options))
        assert got.any()


@pytest.mark.parametrize("dtype", DTYPES)
def test_default_thresholds_follow_the_dtype(backend, dtype):
    full = 1 if np.dtype(dtype).kind in "bf" else np.iinfo(dtype).max
    values = noise(60, 80, dtype="float64")  # about as steep, under this blur, as the thresholds
    image = values < 0.5 if dtype == "bool" else (values * full).astype(dtype)
    for operator in ("gaussian", "sobel", "scharr"):
        low, high = 0.1 * full, 0.2 * full
        options: dict[str, Any] = {"operator": operator}
        got = cvkern.canny(image, 2.0, **options)
        np.testing.assert_array_equal(got, cvkern.canny(image, 2.0, low, high, **options))
        # Others would give other edges.
        for other in ((0.9 * low, high), (low, 0.9 * high), (1.1 * low, high), (low, 1.1 * high)):
            assert (cvkern.canny(image, 2.0, *other, **options) != got).any()
    # Missing ones alone: the high default is never below the low threshold given.
    alone = cvkern.canny(image, 1.0, 0.4 * full)
    np.testing.assert_array_equal(alone, cvkern.canny(image, 1.0, 0.4 * full, 0.4 * full))
    assert alone.any()


# --- properties ----------------------------------------------------------------------------------

shapes = st.tuples(st.integers(1, 30), st.integers(1, 70))
operators = st.sampled_from(["gaussian", "sobel"])
seeds = st.integers(0, 2**16)


@given(
    shape=shapes,
    limits=st.lists(st.floats(0, 60), min_size=4, max_size=4),
    operator=operators,
    norm=st.sampled_from(NORMS),
    seed=seeds,
)
def test_edges_grow_as_thresholds_fall(backend, shape, limits, operator, norm, seed):
    image = blobs(*shape, seed=seed)
    a, b, c, d = sorted(limits)
    options = {"operator": operator, "norm": norm}
    many = cvkern.canny(image, 1.0, a, c, **options)
    few = cvkern.canny(image, 1.0, b, d, **options)
    assert not (few & ~many).any()


@given(shape=shapes, norm=st.sampled_from(NORMS), limit=st.floats(0, 900), seed=seeds)
def test_edges_turn_with_the_image_but_for_ties(backend, shape, norm, limit, seed):
    """One threshold: no hysteresis to carry the rule for ties further than the pixel."""
    image = noise(*shape, dtype="uint8", seed=seed)
    dy, dx = cvkern.gradient(image, sigma=0, operator="sobel", mode="nearest")[:2]
    length = np.abs(dx) + np.abs(dy) if norm == "l1" else dx * dx + dy * dy
    wide = np.pad(length, 1)
    around = np.lib.stride_tricks.sliding_window_view(wide, (3, 3))
    ties = (around == length[..., None, None]).sum((2, 3)) > 1
    got = as_opencv(image, limit, limit, norm)
    for turn in (np.flipud, np.fliplr):
        turned = turn(as_opencv(turn(image), limit, limit, norm))
        np.testing.assert_array_equal(turned[~ties], got[~ties])


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("operator", ["gaussian", "sobel"])
def test_constant_images_have_no_edges(backend, dtype, operator):
    info = np.iinfo(dtype) if np.dtype(dtype).kind in "iu" else None
    for value in (0, 1) if info is None else (0, 1, info.min, info.max):
        for shape in ((1, 1), (1, 30), (20, 40)):
            image = np.full(shape, value, dtype)
            assert not cvkern.canny(image, 1.5, operator=operator).any()
            assert not cvkern.canny(image, 0, 0, 0, operator="sobel").any()
            assert len(cvkern.subpixel_edges(image, 1.5).points) == 0


def test_nan_hides_the_edges_of_its_window_only(backend):
    image = np.zeros((60, 90), np.float32)
    image[10:25, 10:30] = image[35:50, 60:80] = 1  # far apart
    want = cvkern.canny(image, 1.0)
    assert want[:30].any()
    assert want[30:].any()
    image[17, 20] = np.nan
    got = cvkern.canny(image, 1.0)
    touched = np.zeros(image.shape, bool)
    touched[12:23, 15:26] = True  # the kernels reach 4 pixels, thinning one more
    np.testing.assert_array_equal(got[~touched], want[~touched])
    assert not got[13:22, 16:25].any()


@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
def test_layout_does_not_matter(backend, dtype, tmp_path):
    image = blobs(30, 37).astype(dtype)
    choices: list[dict[str, Any]] = [{"operator": "sobel", "sigma": 0}, {"sigma": 1.2}]
    for options in choices:
        want = cvkern.canny(image, low_threshold=5, high_threshold=10, **options)
        points = cvkern.subpixel_edges(image, 1.2, 5, 10)
        assert want.any()
        for name, laid_out in (*layouts(image, tmp_path), ("list", image.tolist())):
            got = cvkern.canny(laid_out, low_threshold=5, high_threshold=10, **options)
            np.testing.assert_array_equal(got, want, err_msg=name)
            for a, b in zip(cvkern.subpixel_edges(laid_out, 1.2, 5, 10), points, strict=True):
                np.testing.assert_array_equal(a, b, err_msg=name)
