"""The guards around the arrays of primitives detect a kernel that writes out of bounds."""

import ctypes

import numpy as np
import pytest

import cvkern.kernels.warp.filters.gradients as gradients
from tests.primitives import F32, Guarded, Primitives


@pytest.mark.parametrize("shape", [(3, 5), (0, 4), (1,), (7, 2, 3)])
@pytest.mark.parametrize("dtype", ["uint8", "float32", "int64", "bool"])
def test_a_guarded_array_is_the_array(shape, dtype):
    values = np.random.default_rng(0).integers(0, 2, shape).astype(dtype)
    guarded = Guarded(values)
    np.testing.assert_array_equal(guarded.array, values)
    assert guarded.array.dtype == dtype
    assert guarded.array.flags.c_contiguous
    assert guarded.array.ctypes.data % 64 == 0 or not values.size
    assert guarded.is_whole()


@pytest.mark.parametrize("at", [-1, 15])
def test_a_kernel_that_writes_beyond_is_seen(monkeypatch, at):
    def stray(dy, dx, magnitude):
        memory = magnitude.numpy().reshape(-1)
        address = memory.__array_interface__["data"][0] + 4 * at
        ctypes.c_float.from_address(address).value = 3

    monkeypatch.setattr(gradients, "root_mean_square", stray)
    dy = np.ones((3, 5), F32)
    with pytest.raises(AssertionError, match="wrote beyond an output"):
        Primitives("warp", "cpu")("filters.gradients.root_mean_square", dy, dy, out=[dy])
