"""The primitives of masks and quantiles of edges, against NumPy."""

import numpy as np
import pytest
import scipy.ndimage as ndi

from cvkern.kernels.codes.edges import Norm
from tests.primitives import F32, I32, U8, noise, waves

SHAPES = [(1, 1), (1, 30), (30, 1), (2, 2), (41, 57), (200, 700)]


@pytest.mark.parametrize("shape", SHAPES)
def test_cover(kernels, shape):
    image = noise(*shape)
    mask = (np.random.default_rng(1).random(shape) < 0.6).astype(U8) * 200
    image[mask == 0] = np.nan
    covered, weight = kernels("edges.slopes.cover", image, mask, out=[(shape, F32)] * 2)
    np.testing.assert_array_equal(covered, np.where(mask, image, 0))
    np.testing.assert_array_equal(weight, mask > 0)


@pytest.mark.parametrize("shape", SHAPES)
def test_recover(kernels, shape):
    image, weight = noise(*shape), np.abs(noise(*shape, seed=1))
    weight[::3] = 0
    got = kernels("edges.slopes.recover", weight, 1e-7, out=[image])
    np.testing.assert_array_equal(got, image / (weight + F32(1e-7)))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("reach", [1, 4, 60])
def test_recover_frame(kernels, shape, reach):
    image = noise(*shape)
    rows, columns = (np.ones(n, F32) for n in shape)
    rng = np.random.default_rng(2)
    for line in (rows, columns):
        near = np.minimum(np.arange(len(line)), np.arange(len(line))[::-1]) < reach
        line[near] = rng.uniform(0.5, 1, near.sum())
    got = kernels("edges.slopes.recover_frame", rows, columns, 0.25, reach, out=[image])
    weight = rows[:, None] * columns + F32(0.25) * (F32(1) - columns)
    np.testing.assert_array_equal(got, image / weight)


@pytest.mark.parametrize("shape", SHAPES)
def test_recover_slopes(kernels, shape):
    dy, dx, smooth, weight_dy, weight_dx = (noise(*shape, seed=i) for i in range(5))
    weight = np.random.default_rng(3).uniform(0.2, 1, shape).astype(F32)
    given = smooth, weight, weight_dy, weight_dx, 2.0**-23
    got = kernels("edges.slopes.recover_slopes", *given, out=[dy, dx])
    share = weight + F32(2.0**-23)
    level = smooth / share
    want = (dy - level * weight_dy) / share, (dx - level * weight_dx) / share
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("density", [0, 0.9, 1])
@pytest.mark.parametrize("shape", SHAPES)
def test_confine(kernels, shape, density):
    mask = (np.random.default_rng(4).random(shape) < density).astype(U8)
    states = np.random.default_rng(5).integers(1, 3, shape, U8)
    got = kernels("edges.slopes.confine", mask, out=[states])
    inside = ndi.binary_erosion(mask, np.ones((3, 3)), border_value=0)
    np.testing.assert_array_equal(got, np.where(inside, states, 0))


def below(values):
    """Return the float32 before each number above 0."""
    return np.where(values > 0, np.nextafter(values, F32(0)), values)


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("norm", Norm)
@pytest.mark.parametrize("shape", SHAPES)
def test_find_limits(kernels, shape, norm, strict):
    for dy, dx in (waves(*shape), (noise(*shape) * 1e-22, noise(*shape) * 1e19)):
        dy[0, 0] = np.nan
        with np.errstate(over="ignore"):
            m = np.abs(dx) + np.abs(dy) if norm == Norm.L1 else dx * dx + dy * dy
        m = np.where(m > 0, m, 0).ravel()  # NaN counts as nothing
        if kernels.name == "taichi" and kernels.device != "cpu":
            m[m < 2.0**-126] = 0  # it flushes them
        last = m.size - 1
        for low, high, share in ((0, last, 0.0), (last // 2, last * 9 // 10, 0.0), (0, 0, 0.25)):
            ranks = np.array([low, high], I32)
            given = dy, dx, norm, ranks, strict, share
            got = kernels("edges.quantiles.find_limits", *given, out=[((2,), F32)])
            want = np.sort(m)[ranks]
            want = want if strict else below(want)
            least = F32(0)
            if share:
                least = m.max() * F32(share) * (F32(share) if norm == Norm.L2 else F32(1))
            np.testing.assert_array_equal(got, np.maximum(want, least))
