"""The kernel sets give the same bits: results are equal, not similar."""

import cv2
import numpy as np
import pytest
import skimage.data
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from cvkern._runtime import KERNEL_SETS
from cvkern.kernels.taichi._denormals import can_keep_denormals
from tests.calls import CALLS, DTYPES, MODES, ROUNDED, blobs, fields, noise

pytestmark = pytest.mark.filterwarnings("ignore:no edge was found")

shapes = st.tuples(st.integers(1, 40), st.integers(1, 70))
dtypes = st.sampled_from(DTYPES)
modes = st.sampled_from(MODES)
cvals = st.floats(-10, 10, width=32)
seeds = st.integers(0, 2**16)
# Only squares of numbers below 1e-19 fall out of float32's normal range in what is computed.
scales = st.sampled_from([1.0, 255.0, 1e-9, 1e6, -3.7e12])


def assert_equal_bits(call):
    """Run `call` under each kernel set; compare every bit of every array it returns."""
    answers = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            answers.append(fields(call()))
    first, *others = answers
    for answer in others:
        for a, b in zip(first, answer, strict=True):
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            np.testing.assert_array_equal(a.view(f"u{a.itemsize}"), b.view(f"u{b.itemsize}"))
    return first


def image_of(shape, dtype, scale, seed):
    image = noise(*shape, dtype=dtype, seed=seed)
    if image.dtype in (np.float32, np.float64):
        image = (image - 0.5) * image.dtype.type(scale)
    return image


@given(shapes, dtypes, scales, seeds, st.tuples(st.floats(0, 6), st.floats(0, 6)),
       st.integers(0, 3), modes, cvals)  # fmt: skip
def test_gaussian(shape, dtype, scale, seed, sigma, order, mode, cval):
    image = image_of(shape, dtype, scale, seed)
    assert_equal_bits(lambda: cvkern.gaussian(image, sigma, order=order, mode=mode, cval=cval))


@given(shapes, st.integers(1, 5), st.sampled_from([0, 1, 2]), seeds, modes, cvals)
def test_gaussian_of_channels(shape, channels, axis, seed, mode, cval):
    image = np.moveaxis(noise(channels, *shape, seed=seed), 0, axis)
    options = {"mode": mode, "cval": cval, "channel_axis": axis}
    assert_equal_bits(lambda: cvkern.gaussian(image, 1.7, **options))
    assert_equal_bits(lambda: cvkern.box(image, (2, 5), **options))


@given(shapes, st.integers(0, 12), st.integers(0, 40), seeds, modes, cvals)
def test_correlate_separable(shape, down, along, seed, mode, cval):
    rng = np.random.default_rng(seed)
    taps = rng.normal(size=2 * down + 1), rng.normal(size=2 * along + 1)
    image = noise(*shape, seed=seed)
    assert_equal_bits(lambda: cvkern.correlate_separable(image, taps, mode=mode, cval=cval))


@given(shapes, dtypes, scales, seeds, st.sampled_from([
    ("gaussian", 1.0), ("gaussian", 3.3), ("sobel", 0), ("sobel", 1.4), ("scharr", 0),
    ("scharr", 2.2)]), modes, cvals)  # fmt: skip
def test_gradient(shape, dtype, scale, seed, operator, mode, cval):
    image = image_of(shape, dtype, scale, seed)
    name, sigma = operator
    options = {"operator": name, "sigma": sigma, "mode": mode, "cval": cval}
    assert_equal_bits(lambda: cvkern.gradient(image, **options))
    for call in (cvkern.sobel, cvkern.scharr):
        assert_equal_bits(lambda: call(image, mode=mode, cval=cval))  # noqa: B023


@given(shapes, st.sampled_from(["uint8", "int16", "float32"]), seeds,
       st.sampled_from(["gaussian", "sobel", "scharr"]), st.sampled_from(["l1", "l2"]),
       st.sampled_from(["interpolated", "sectors"]), st.sampled_from([0, 0.8, 2.0]), modes,
       st.tuples(st.floats(0, 150), st.floats(0, 150)), st.booleans(), st.booleans())  # fmt: skip
def test_canny(shape, dtype, seed, operator, norm, rule, sigma, mode, limits, quantiles, masked):
    image, (low, high) = blobs(*shape, seed=seed).astype(dtype), sorted(limits)
    options = {"operator": operator, "norm": norm, "mode": mode, "cval": 99, "suppression": rule}
    if quantiles:
        low, high = low / 150, high / 150
        options["use_quantiles"] = True
    if masked:
        options["mask"] = blobs(*shape, seed=seed + 1) > 60
    sigma = max(sigma, 0.5) if operator == "gaussian" else sigma
    assert_equal_bits(lambda: cvkern.canny(image, sigma, low, high, **options))


@given(shapes, dtypes, scales, seeds, st.integers(1, 4), modes)
def test_median(shape, dtype, scale, seed, radius, mode):
    image = image_of(shape, dtype, scale, seed)
    assert_equal_bits(lambda: cvkern.median(image, radius, mode=mode, cval=1))


@given(shapes, seeds, st.floats(0.2, 9), st.integers(1, 40), st.sampled_from([None, 0, 0.05, 2]),
       st.booleans())  # fmt: skip
def test_hough_line(shape, seed, rho_step, angles, tolerance, weighted):
    rng = np.random.default_rng(seed)
    mask = rng.random(shape) < 0.2
    theta = np.linspace(-1, 2, angles)
    options = {"rho_step": rho_step}
    if tolerance is not None:
        options |= {
            "orientation": rng.uniform(-4, 4, shape).astype(np.float32),
            "orientation_tolerance": tolerance,
        }
    if weighted:
        options |= {"weights": rng.random(shape).astype(np.float32)}
    (votes,) = assert_equal_bits(lambda: cvkern.hough_line(mask, theta, **options).votes)
    for values in (votes, votes.astype(np.float32)):
        rho = np.arange(len(votes)) * 1.0
        assert_equal_bits(lambda: cvkern.hough_line_peaks(values, theta, rho, 3, 2, 0.5))  # noqa: B023
    points = np.argwhere(mask) * 0.99
    assert_equal_bits(lambda: cvkern.hough_line(points=points, shape=shape).votes)
    assert_equal_bits(lambda: cvkern.hough_line_slope(mask, np.linspace(-1, 1, angles))[:2])
    lines = rng.uniform(-2, 2, 9), rng.uniform(-20, 40, 9)
    assert_equal_bits(lambda: cvkern.hough_line_segments(mask, *lines, min_length=2, distance=3))


@pytest.mark.parametrize("name", sorted(set(CALLS) - ROUNDED))
def test_a_photograph(name):
    """Large enough for several threads in either set."""
    camera = cv2.resize(skimage.data.camera(), (701, 487))
    results = assert_equal_bits(lambda: CALLS[name](camera))
    assert all(a.any() for a in results)


@pytest.mark.parametrize("name", ["gaussian", "gradient", "median", "canny"])
def test_the_same_bits_from_run_to_run(name, backend):
    image = skimage.data.camera()
    first = fields(CALLS[name](image))
    for _ in range(3):
        for a, b in zip(first, fields(CALLS[name](image)), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("scale", [1e-22, 1e-30, 1e-38])
def test_numbers_too_small_for_float32(scale):
    """Where Taichi takes what is below float32's normal range for 0, it is the one difference."""
    image = (noise(20, 40) * scale).astype(np.float32)
    lost = 2.0**-126
    for name in ("gaussian", "derivative", "sobel", "gradient"):
        answers = []
        for kernels in KERNEL_SETS:
            with cvkern.use(backend=kernels):
                answers.append(fields(CALLS[name](image)))
        warp, taichi = answers
        if can_keep_denormals():
            for a, b in zip(warp, taichi, strict=True):
                np.testing.assert_array_equal(a.view(np.int32), b.view(np.int32))
            continue
        for a, b in zip(warp[:3], taichi[:3], strict=True):
            # A sum loses at most `lost` for each of its terms, the root of a sum the root of that.
            assert np.abs(a - b).max() <= np.sqrt(100 * lost)
            if name in ("gaussian", "derivative"):
                assert np.abs(a - b).max() <= 100 * lost


@given(shapes, seeds, st.sampled_from([1, 2, 4, 8, 16]), st.floats(0, 0.5), st.integers(1, 7))
def test_generalized_hough(shape, seed, cell, tolerance, rotations):
    """Long vectors too: they leave the image, and an accumulator is in several parts on a GPU."""
    rng = np.random.default_rng(seed)
    mask, angle = rng.random(shape) < 0.2, rng.uniform(-7, 7, shape)
    vectors = rng.normal(0, rng.choice([3, 30, 900]), (50, 2)).clip(-4096, 4096)
    table = cvkern.RTable(vectors, rng.uniform(-7, 7, 50), np.zeros(2), (9, 9))
    options = {"orientation": angle, "orientation_tolerance": tolerance, "cell": cell,
               "rotations": rotations, "scales": rng.uniform(0.07, 16, 3)}  # fmt: skip
    assert_equal_bits(lambda: cvkern.generalized_hough_votes(mask, table, **options))
    assert_equal_bits(lambda: cvkern.generalized_hough(mask, table, threshold=0, **options))


@given(shapes, st.sampled_from(["uint8", "uint16", "float32"]), scales, seeds,
       st.sampled_from(["sad", "ssd", "birchfield_tomasi", "zncc", "census", "census_symmetric"]),
       st.tuples(st.integers(0, 5), st.integers(0, 5)), st.integers(-9, 9), st.integers(1, 40),
       st.integers(1, 3))  # fmt: skip
def test_stereo_cost(shape, dtype, scale, seed, cost, radii, first, count, channels):
    left, right = (
        image_of((*shape, channels), dtype, min(scale, 1e6), s) for s in (seed, seed + 1)
    )
    first = min(max(first, 1 - shape[1]), shape[1] - 1)
    assert_equal_bits(
        lambda: cvkern.stereo_cost(
            left, right, (first, min(first + count, shape[1])), cost=cost,
            window=tuple(2 * r + 1 for r in radii), neighborhood=(5, 7), channel_axis=-1,
        )
    )  # fmt: skip


@given(shapes, st.integers(1, 70), st.sampled_from([4, 8, 16]), st.integers(0, 60),
       st.integers(0, 400), st.booleans(), st.sampled_from(["uint8", "uint16"]), seeds,
       st.sampled_from([False, True, "equiangular"]), st.integers(0, 99))  # fmt: skip
def test_semi_global(shape, depth, paths, p1, more, guided, dtype, seed, subpixel, uniqueness):
    costs = noise(shape[0] // 3 + 1, shape[1] // 3 + 1, depth, dtype="uint8", seed=seed)
    guide = noise(*costs.shape[:2], dtype="uint8", seed=seed) if guided else None
    sums, *_ = assert_equal_bits(
        lambda: cvkern.aggregate_semi_global(
            costs.astype(dtype), p1, p1 + more, paths=paths, guide=guide
        )
    )
    for volume in (costs, sums, sums.astype(np.float32) / np.float32(7)):
        assert_equal_bits(
            lambda volume=volume: cvkern.winner_take_all(
                volume, first=-depth // 2, subpixel=subpixel, uniqueness=uniqueness
            )
        )


@given(shapes, st.sampled_from(["uint8", "uint16", "float32"]), seeds,
       st.sampled_from(["semi-global", "window"]), st.sampled_from([4, 8, 16]),
       st.integers(-9, 9), st.integers(1, 40), st.sampled_from([False, True, "equiangular"]),
       st.integers(0, 30), st.sampled_from([None, 0.3, 1.0]), st.integers(0, 12),
       st.integers(0, 8))  # fmt: skip
def test_stereo_match(shape, dtype, seed, method, paths, first, count, subpixel, uniqueness,
                      left_right, speckle_size, smoothing):  # fmt: skip
    left, right = (noise(*shape, dtype=dtype, seed=s) for s in (seed, seed + 1))
    right[:, : -first or None] = left[:, first:] if first > 0 else right[:, : -first or None]
    first = min(max(first, 1 - shape[1]), shape[1] - 1)
    assert_equal_bits(
        lambda: cvkern.stereo_match(
            left, right, (first, min(first + count, shape[1])), method=method, paths=paths,
            subpixel=subpixel, uniqueness=uniqueness, left_right=left_right,
            speckle_size=speckle_size, smoothing=smoothing, window=5,
        )
    )  # fmt: skip


def test_orientations_beside_nan_and_infinity():
    image = noise(9, 70).astype(np.float32)
    image[4, 30], image[2, 10], image[2, 12] = np.nan, np.inf, -np.inf
    found = []
    for kernels in KERNEL_SETS:
        with cvkern.use(backend=kernels):
            found.append(cvkern.gradient(image, sigma=1.0))
    alone = np.isnan(found[0].dy) ^ np.isnan(found[0].dx)
    assert alone.any()
    for gradient in found:
        assert np.isnan(gradient.orientation[alone]).all()
    np.testing.assert_array_equal(*(gradient.orientation for gradient in found))
