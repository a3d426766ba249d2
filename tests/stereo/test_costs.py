"""Matching costs against their definitions in int64 and float64, and closed forms."""

from typing import Any

import cv2
import numpy as np
import pytest

import cvkern
from cvkern.kernels.codes.stereo import Cost
from tests.stereo import reference_costs as reference

COSTS = [cost.name.lower() for cost in Cost]
SUMS = ["sad", "ssd", "birchfield_tomasi"]
CENSUS = ["census", "census_symmetric"]


def pair(*shape: int, dtype: Any = np.uint8, shift: int = 2, seed: int = 0) -> Any:
    """Two views of one texture `shift` pixels apart, with noise, ties and flat parts."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, 256, shape)
    left[: shape[0] // 3] = 77
    right = np.roll(left, -shift, 1) + rng.integers(-9, 10, shape)
    images = left, right.clip(0, 255)
    if np.dtype(dtype).kind == "f":
        images = [image + rng.random(shape) for image in images]
    return tuple(image.astype(dtype) for image in images)


def deep(image):
    return image.reshape(*image.shape[:2], -1)


def expected(left, right, disparities, cost, window=(1, 1), around=(7, 9), spacing=1):
    radii, around = ([side // 2 for side in sides] for sides in (window, around))
    return reference.stereo_cost(deep(left), deep(right), disparities, cost, radii, around, spacing)


SHAPES = [(1, 1), (1, 40), (23, 1), (9, 14), (31, 75), (8, 13, 3)]
WINDOWS = [(1, 1), (7, 1), (21, 9)]


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cost", SUMS)
def test_sums_of_bytes_are_exact(backend, cost, shape, window):
    left, right = pair(*shape)
    axis = 2 if len(shape) == 3 else None
    for disparities in ((0, 1), (-shape[1] + 1, shape[1])):
        got = cvkern.stereo_cost(
            left, right, disparities, cost=cost, window=window, channel_axis=axis
        )
        want = expected(left, right, disparities, cost, window)
        np.testing.assert_array_equal(got, want.astype(got.dtype))
        assert got.dtype != np.float32 or np.array_equal(got, want.astype(np.float32))


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cost", SUMS)
def test_sums_of_floats(backend, cost, shape, window):
    left, right = pair(*shape, dtype=np.float32)
    axis = 2 if len(shape) == 3 else None
    disparities = max(-3, 1 - shape[1]), min(6, shape[1])
    got = cvkern.stereo_cost(left, right, disparities, cost=cost, window=window, channel_axis=axis)
    assert got.dtype == np.float32
    want = expected(left, right, disparities, cost, window)
    # Sums of n terms of at most t each, with differences rounded to 2^-24 of 257 (half a step
    # more where halves are taken), float32 loses at most n (n + 3) t 2^-24; squares twice that.
    terms = np.prod(window) * deep(left).shape[2]
    largest = 257.0 ** (2 if cost == "ssd" else 1)
    assert np.abs(got - want).max() <= 2 * terms * (terms + 3) * largest * 2**-24


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("window", [(3, 3), (1, 5), (11, 7)])
@pytest.mark.parametrize("shape", SHAPES)
def test_zncc(backend, shape, window, dtype):
    left, right = pair(*shape, dtype=dtype)
    axis = 2 if len(shape) == 3 else None
    disparities = max(-3, 1 - shape[1]), min(6, shape[1])
    options = {"cost": "zncc", "window": window, "channel_axis": axis}
    got = cvkern.stereo_cost(left, right, disparities, **options)
    assert got.dtype == np.float32
    want = expected(left, right, disparities, "zncc", window)
    # Rounded once from float64, to half a step below 2. Of floats the variance is a difference of
    # float64 numbers up to 2^-53 n^2 257^2 wrong, against some n^2: far below that.
    np.testing.assert_allclose(got, want, rtol=0, atol=2.0**-23)


@pytest.mark.parametrize("window", [(1, 1), (5, 3)])
@pytest.mark.parametrize("around", [(7, 9), (1, 3), (1, 65), (5, 7)])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cost", CENSUS)
def test_census(backend, cost, shape, around, window):
    axis = 2 if len(shape) == 3 else None
    disparities = -min(3, shape[1] - 1), min(7, shape[1])
    for dtype, spacing in ((np.uint8, 1), (np.float32, 2)):
        left, right = pair(*shape, dtype=dtype)
        got = cvkern.stereo_cost(
            left, right, disparities, cost=cost, window=window, neighborhood=around,
            spacing=spacing, channel_axis=axis,
        )  # fmt: skip
        want = expected(left, right, disparities, cost, window, around, spacing)
        np.testing.assert_array_equal(got, want)


def test_many_disparities(backend):
    """More than 256, and no multiple of any vector's length."""
    left, right = pair(3, 400)
    for cost in COSTS:
        disparities = -27, 330
        got = cvkern.stereo_cost(left, right, disparities, cost=cost, window=3)
        want = expected(left, right, disparities, cost, (3, 3))
        np.testing.assert_allclose(got, want, rtol=0, atol=2.0**-23 if cost == "zncc" else 0)


@pytest.mark.parametrize(
    ("cost", "window", "channels", "dtype", "want"),
    [
        ("sad", 1, 1, "uint8", "uint8"),
        ("sad", 1, 3, "uint8", "uint16"),
        ("sad", (1, 257), 1, "uint8", "uint16"),
        ("sad", 17, 1, "uint8", "float32"),
        ("ssd", 1, 1, "uint8", "uint16"),
        ("ssd", 3, 1, "uint8", "float32"),
        ("sad", 1, 1, "uint16", "float32"),
        ("zncc", 3, 1, "uint8", "float32"),
        ("census", 1, 4, "float32", "uint8"),
        ("census", 1, 5, "uint8", "uint16"),
        ("census", 31, 1, "int32", "uint16"),
        ("census", 33, 1, "uint8", "float32"),
    ],
)
def test_dtypes_hold_every_cost(backend, cost, window, channels, dtype, want):
    """Also the largest: black against white; a census of 7 x 9 has 62 bits."""
    left = np.zeros((2, 3, channels), dtype)
    right = np.full_like(left, 255)
    costs = cvkern.stereo_cost(left, right, (0, 2), cost=cost, window=window, channel_axis=-1)
    assert costs.dtype == want
    area = np.prod(np.broadcast_to(window, 2)) * channels
    largest = {"sad": 255 * area, "ssd": 255**2 * area, "zncc": 1, "census": 0}[cost]
    assert (costs == np.float32(largest)).all()


@pytest.mark.parametrize("cost", COSTS)
def test_a_pair_without_noise_costs_nothing_at_its_disparity(backend, cost):
    texture = np.random.default_rng(1).integers(0, 256, (20, 60)).astype(np.uint8)
    left, right = texture[:, 5:45], texture[:, 12:52]  # x - 7 there
    costs = cvkern.stereo_cost(left, right, (0, 12), cost=cost)
    inner = costs[5:-5, 12:-5]
    assert (inner.argmin(-1) == 7).all()
    # 1 less a correlation of float64, rounded once.
    assert inner[..., 7].max() <= (1e-12 if cost == "zncc" else 0)


@pytest.mark.parametrize("cost", CENSUS)
def test_census_does_not_see_brightness_and_contrast(backend, cost):
    left, right = pair(12, 30)
    left, right = left // 4, right // 4
    want = cvkern.stereo_cost(left, right, (0, 9), cost=cost)
    np.testing.assert_array_equal(cvkern.stereo_cost(left + 60, right, (0, 9), cost=cost), want)
    brighter = cvkern.stereo_cost(2 * left + 9, 3 * right, (0, 9), cost=cost)
    np.testing.assert_array_equal(brighter, want)


def test_zncc_does_not_see_brightness_and_contrast(backend):
    left, right = pair(12, 30)
    left, right = left // 4, right // 4
    want = cvkern.stereo_cost(left, right, (0, 9), cost="zncc")
    got = cvkern.stereo_cost(2 * left + 9, 3 * right + 20, (0, 9), cost="zncc")
    np.testing.assert_allclose(got, want, rtol=0, atol=2.0**-23)
    assert want.min() >= 0
    assert want.max() <= 2
    opposite = cvkern.stereo_cost(left, 63 - left, (0, 1), cost="zncc", window=5)
    np.testing.assert_allclose(opposite[-6:], 2, rtol=0, atol=2.0**-23)


def test_zncc_of_constant_windows(backend):
    left, right = pair(12, 30, dtype=np.float32)
    left[:8] = np.float32(0.1)
    assert (cvkern.stereo_cost(left, right, (0, 4), cost="zncc", window=3)[:7] == 1).all()


def test_birchfield_tomasi_does_not_see_half_a_pixel(backend):
    """Of straight lines sampled anywhere, a value lies between those half way to its neighbours."""
    x = np.arange(40, dtype=np.float32)
    left, right = (np.tile(4 * (x + part), (3, 1)) for part in (0, 3.4))
    costs = cvkern.stereo_cost(left, right, (0, 6), cost="birchfield_tomasi", window=1)
    # Disparity 3 is 0.4 pixels off. One step of float32 for sums below 256.
    assert costs[:, 6:-6, 3].max() <= 2.0**-16
    assert costs[:, 6:-6, [2, 4]].min() > 0


def test_sad_is_opencvs_box_of_differences(backend):
    left, right = pair(20, 33, dtype=np.float32)
    costs = cvkern.stereo_cost(left, right, (4, 5), cost="sad", window=(3, 7))[..., 0]
    gap = np.abs(left[:, 4:] - right[:, :-4])
    want = cv2.boxFilter(gap.astype(np.float64), -1, (7, 3), normalize=False)
    # 21 terms below 257, as above.
    np.testing.assert_allclose(costs[1:-1, 7:-3], want[1:-1, 3:-3], rtol=0, atol=21 * 24 * 2**-16)


@pytest.mark.parametrize("cost", COSTS)
def test_channels_may_stand_anywhere(backend, cost):
    left, right = pair(7, 20, 3)
    want = cvkern.stereo_cost(left, right, (0, 5), cost=cost, channel_axis=2)
    for axis in (0, 1, -1):
        one, other = (np.moveaxis(image, 2, axis) for image in (left, right))
        got = cvkern.stereo_cost(one, other, (0, 5), cost=cost, channel_axis=axis)
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize(
    "dtype", ["bool", "int8", "uint16", "int32", "int64", "float16", "float64"]
)
def test_other_dtypes_count_as_float32(backend, dtype):
    left, right = (image.astype(dtype) for image in pair(6, 15))
    for cost in COSTS:
        got = cvkern.stereo_cost(left, right, (0, 4), cost=cost)
        floats = left.astype(np.float32), right.astype(np.float32)
        want = cvkern.stereo_cost(*floats, (0, 4), cost=cost)
        assert got.dtype == want.dtype
        np.testing.assert_array_equal(got, want)
        mixed = cvkern.stereo_cost(left, floats[1], (0, 4), cost=cost)
        np.testing.assert_array_equal(mixed, want)


def test_libraries_keep_their_arrays(backend):
    torch = pytest.importorskip("torch")
    left, right = pair(6, 15, 3)
    for axis in (0, 2):
        one, other = (np.ascontiguousarray(np.moveaxis(i, 2, axis)) for i in (left, right))
        tensors = torch.from_numpy(one), torch.from_numpy(other)
        got = cvkern.stereo_cost(*tensors, (0, 4), channel_axis=axis)
        assert isinstance(got, torch.Tensor)
        want = cvkern.stereo_cost(one, other, (0, 4), channel_axis=axis)
        np.testing.assert_array_equal(got.numpy(), want)


def test_inputs_are_left_alone(backend):
    left, right = pair(9, 20)
    before = left.copy(), right.copy()
    for cost in COSTS:
        cvkern.stereo_cost(left, right, (0, 9), cost=cost)
    np.testing.assert_array_equal((left, right), before)


def test_slabs_do_not_show(monkeypatch):
    """Many threads, whose sums begin anew."""
    left, right = pair(90, 120)
    wanted = [cvkern.stereo_cost(left, right, (0, 50), cost=cost, window=7) for cost in COSTS]
    monkeypatch.setenv("CVKERN_NUM_THREADS", "5")
    for cost, want in zip(COSTS, wanted, strict=True):
        got = cvkern.stereo_cost(left, right, (0, 50), cost=cost, window=7)
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("cost", ["sad", "census", "zncc"])
@pytest.mark.parametrize("shape", [(3, 9, 14), (2, 8, 13, 3)])
def test_stacks(backend, cost, shape):
    """The costs of a stack of pairs are those of each pair, in every bit."""
    pairs = [pair(*shape[1:], seed=seed) for seed in range(shape[0])]
    left, right = map(np.stack, zip(*pairs, strict=True))
    got = cvkern.stereo_cost(left, right, (-2, 5), cost=cost, batch_axis=0)
    want = [cvkern.stereo_cost(a, b, (-2, 5), cost=cost) for a, b in pairs]
    np.testing.assert_array_equal(got, np.stack(want))
    if len(shape) == 4:
        one, other = (np.moveaxis(images, -1, 1) for images in (left, right))
        got = cvkern.stereo_cost(one, other, (-2, 5), cost=cost, channel_axis=1, batch_axis=0)
        np.testing.assert_array_equal(got, np.stack(want))
    with pytest.raises(ValueError, match=r"batch_axis must be in \[0, 0\], got 1"):
        cvkern.stereo_cost(left, right, (0, 4), batch_axis=1)
