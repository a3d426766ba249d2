"""The median against SciPy, for every dtype, border and layout."""

from typing import Any

import numpy as np
import pytest
import scipy.ndimage as ndi
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.calls import DTYPES, MODES, layouts, noise

SHAPES = [(1, 1), (1, 40), (37, 1), (6, 5), (17, 70)]


PAD: dict[str, Any] = {
    "reflect": {"mode": "symmetric"},
    "constant": {"mode": "constant"},
    "nearest": {"mode": "edge"},
    "mirror": {"mode": "reflect"},
    "wrap": {"mode": "wrap"},
}


def reference(image, radius, mode="reflect", cval=0):
    """Sort each window (SciPy knows neither bool nor float16, and rounds 64-bit integers)."""
    fill: dict[str, Any] = {"constant_values": cval} if mode == "constant" else {}
    wide = np.pad(image, radius, **PAD[mode], **fill)
    size = 2 * radius + 1
    windows = np.lib.stride_tricks.sliding_window_view(wide, (size, size))
    return np.sort(windows.reshape(*image.shape, -1), axis=-1)[..., size * size // 2]


def assert_same(got, want):
    assert got.dtype == want.dtype
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("shape", [(1, 1), (5, 40), (33, 70)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("radius", [8, 15])
def test_large_windows_are_scipys(backend, shape, dtype, radius):
    image = (np.random.default_rng(radius).random(shape) * 255).astype(dtype)
    got = cvkern.median(image, radius, mode="mirror")
    assert_same(got, ndi.median_filter(image, 2 * radius + 1, mode="mirror"))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("radius", [1, 2, 7])
@pytest.mark.parametrize("shape", SHAPES)
def test_median_is_scipys(backend, shape, radius, mode):
    image = noise(*shape, dtype="uint8")
    got = cvkern.median(image, radius, mode=mode, cval=77)
    assert_same(got, ndi.median_filter(image, 2 * radius + 1, mode=mode, cval=77))


@pytest.mark.parametrize("mode", ["reflect", "constant"])
@pytest.mark.parametrize("radius", [1, 3])
@pytest.mark.parametrize("dtype", DTYPES)
def test_every_dtype_is_kept(backend, dtype, radius, mode):
    image = noise(13, 19, dtype=dtype)
    if image.dtype.kind == "f":
        image = (image - np.asarray(0.5, dtype)) * np.asarray(1000, dtype)
    for cval in (0, 1):
        got = cvkern.median(image, radius, mode=mode, cval=cval)
        assert_same(got, reference(image, radius, mode, cval))


@pytest.mark.parametrize("dtype", ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64"])
def test_the_ends_of_the_range(backend, dtype):
    info = np.iinfo(dtype)
    rng = np.random.default_rng(4)
    image = rng.choice(np.array([info.min, info.max, 0, 1, info.max - 1], dtype), (11, 12))
    assert_same(cvkern.median(image, 1), reference(image, 1))
    for value in (info.min, info.max):
        constant = np.full((4, 5), value, dtype)
        assert_same(cvkern.median(constant, 2), constant)


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
def test_the_ends_of_the_range_of_floats(backend, dtype):
    info = np.finfo(dtype)
    rng = np.random.default_rng(4)
    values = [info.min, info.max, info.tiny, -info.tiny, info.smallest_subnormal, 0, -0.0, 1]
    image = rng.choice(np.array([*values, np.inf, -np.inf], dtype), (11, 12))
    assert_same(cvkern.median(image, 1), reference(image, 1))


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
@pytest.mark.parametrize("nan", [np.nan, -np.nan])
def test_nan_counts_as_the_largest(backend, dtype, nan):
    """Whatever its sign bit: x86 sets that of inf - inf."""
    image = noise(9, 10, dtype=dtype)
    holes = np.random.default_rng(1).random(image.shape) < 0.3
    image[holes] = nan
    want = reference(image, 1)  # np.sort puts NaN last
    assert 0 < np.isnan(want).sum() < want.size
    assert_same(cvkern.median(image, 1), want)


@pytest.mark.parametrize("axis", [0, 1, 2, -1, -2, -3])
@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
def test_channels_are_filtered_apart(backend, dtype, axis):
    planes = noise(3, 9, 14, dtype=dtype)
    image = np.moveaxis(planes, 0, axis)
    got = cvkern.median(image, 2, channel_axis=axis)
    assert got.dtype == image.dtype
    assert got.shape == image.shape
    for i, plane in enumerate(planes):
        np.testing.assert_array_equal(np.take(got, i, axis), reference(plane, 2))


@pytest.mark.parametrize("dtype", ["uint8", "int32", "int64", "float16", "float32", "float64"])
def test_layout_does_not_matter(backend, dtype, tmp_path):
    image = noise(9, 37, dtype=dtype)
    want = reference(image, 1)
    for name, laid_out in layouts(image, tmp_path):
        got = cvkern.median(laid_out, 1)
        np.testing.assert_array_equal(got, want, err_msg=name)
        assert got.dtype == laid_out.dtype, name
    np.testing.assert_array_equal(cvkern.median(image.tolist(), 1), want)


@pytest.mark.parametrize("dtype", ["uint8", "int64", "float16", "float32"])
@pytest.mark.parametrize("axis", [None, 0, 1, 2])
def test_out_is_filled_and_returned(backend, dtype, axis):
    image = noise(*((8, 9) if axis is None else (4, 8, 9)), dtype=dtype)
    out = np.zeros_like(image)
    assert cvkern.median(image, 2, channel_axis=axis, out=out) is out
    np.testing.assert_array_equal(out, cvkern.median(image, 2, channel_axis=axis))


# --- properties ----------------------------------------------------------------------------------

shapes = st.tuples(st.integers(1, 16), st.integers(1, 70))
radii = st.integers(1, 4)
modes = st.sampled_from(MODES)
seeds = st.integers(0, 2**16)


@given(shape=shapes, radius=radii, mode=modes, seed=seeds)
def test_median_commutes_with_rising_maps(backend, shape, radius, mode, seed):
    image = noise(*shape, dtype="uint8", seed=seed)
    middle = cvkern.median(image, radius, mode=mode)
    table = np.sort(np.random.default_rng(seed).normal(size=256).astype(np.float32))
    table[0] = min(table[0], 0)
    got = cvkern.median(table[image], radius, mode=mode, cval=float(table[0]))
    np.testing.assert_array_equal(got, table[middle])


@given(shape=shapes, radius=radii, mode=modes, seed=seeds)
def test_median_turns_with_the_image(backend, shape, radius, mode, seed):
    image = noise(*shape, dtype="int16", seed=seed)
    want = cvkern.median(image, radius, mode=mode)
    for turn in (np.flipud, np.fliplr, np.transpose):
        np.testing.assert_array_equal(cvkern.median(turn(image), radius, mode=mode), turn(want))
    np.testing.assert_array_equal(cvkern.median(~image, radius, mode=mode, cval=-1), ~want)


@given(shape=shapes, radius=radii, dtype=st.sampled_from(DTYPES), seed=seeds)
def test_median_is_a_value_of_its_window(backend, shape, radius, dtype, seed):
    image = noise(*shape, dtype=dtype, seed=seed)
    got = cvkern.median(image, radius)
    assert np.isin(got, image).all()
    carried = image.view(np.uint8) if image.dtype == bool else image.astype(float)
    size = 2 * radius + 1
    assert (got >= ndi.minimum_filter(carried, size)).all()
    assert (got <= ndi.maximum_filter(carried, size)).all()


@given(shape=shapes, radius=radii, mode=modes, value=st.floats(width=32, allow_nan=False))
def test_median_keeps_constants(backend, shape, radius, mode, value):
    image = np.full(shape, value, np.float32)
    cval = value if np.isfinite(value) else 0.0
    got = cvkern.median(image, radius, mode="nearest" if np.isinf(value) else mode, cval=cval)
    np.testing.assert_array_equal(got, image)


def test_impulses_vanish(backend):
    image = np.full((20, 40), 7, np.uint16)
    image[5, 5], image[10, 30] = 65535, 0
    np.testing.assert_array_equal(cvkern.median(image), 7)
