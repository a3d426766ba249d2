"""The list of a mask's set pixels, and the check of values there."""

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.hough._points import check_at_points, mask_points

SHAPES = [(1, 1), (1, 7), (9, 8), (40, 513), (700, 333)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", [0, 0.02, 0.5, 1])
def test_points_are_the_set_pixels_in_raster_order(backend, shape, share):
    mask = np.random.default_rng(1).random(shape) < share
    rt = runtime(mask)
    found = mask_points(rt, mask, "test")
    want = np.argwhere(mask)
    assert found.capacity == len(want)
    assert found.height == shape[0]
    np.testing.assert_array_equal(rt.to_numpy(found.points)[: len(want)], want)
    np.testing.assert_array_equal(
        rt.to_numpy(found.starts), np.concatenate(([0], np.cumsum(mask.sum(1))))
    )


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_any_value_but_zero_is_set(backend, dtype):
    mask = np.zeros((5, 20), dtype)
    mask[[0, 3, 4], [2, 19, 0]] = 2, 1, 100
    if dtype == np.float32:
        mask[1, 1] = np.nan
    rt = runtime(mask)
    found = mask_points(rt, mask, "test")
    np.testing.assert_array_equal(
        rt.to_numpy(found.points)[: found.capacity], np.argwhere(mask != 0)
    )


@pytest.mark.parametrize("wrong", [np.nan, -0.5, 2.5, np.inf])
def test_the_first_value_out_of_range_is_named(backend, wrong):
    rng = np.random.default_rng(2)
    mask = rng.random((30, 40)) < 0.3
    values = rng.random((30, 40)).astype(np.float32)
    values[~mask] = np.nan  # nobody looks there
    rt = runtime(mask)
    found = mask_points(rt, mask, "test")
    values[tuple(np.argwhere(mask)[3:5].T)] = 0, 2  # both bounds are in range
    check_at_points(rt, found, rt.adopt(values), "weights", 0, 2)
    row, column = np.argwhere(mask)[57]
    values[row, column] = values[-1, -1] = wrong
    mask[-1, -1] = True
    found = mask_points(rt, mask, "test")
    with pytest.raises(ValueError, match=rf"weights must be in \[0, 2\] .* \({row}, {column}\)"):
        check_at_points(rt, found, rt.adopt(values), "weights", 0, 2)
