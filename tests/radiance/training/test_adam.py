"""Steps of Adam, their rate, and the clipping of gradients."""

from typing import Any

import numpy as np
import pytest

from cvkern.kernels.codes.radiance import AdamRule, Learnt
from tests.radiance import reference_radiance as reference

F16, F32, I32 = np.float16, np.float32, np.int32


def noise(*shape, dtype: Any = F32, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


def number(value):
    return np.array([value], I32)


BETA1, BETA2, EPSILON = 0.9, 0.99, 1e-8


def schedule(kernels, step, progress=0.0, base=0.02, warmup=0, final=0.1):
    return kernels(
        "radiance.training.adam.learning_rate",
        number(step),
        np.array([progress], F32),
        base,
        warmup,
        final,
        BETA1,
        BETA2,
        out=[((3,), F32)],
    )


def learn(kernels, rate, arrays, *, factor=1.0, decay=0.0, sparse=False):
    """Take a step with gradients, means, squares, weights and their copy."""
    given = rate, np.array([factor], F32), AdamRule(BETA1, BETA2, EPSILON, decay, sparse)
    *learnt, copy = arrays
    return kernels("radiance.training.adam.adam", *given, out=[Learnt(*learnt), copy])


@pytest.mark.parametrize("count", [1, 3, 4, 1002])  # by four, and what is left over
def test_adam_is_that_of_the_paper(kernels, half, count):
    weights, gradients = noise(count), [noise(count, seed=t) for t in range(1, 20)]
    arrays = [*np.zeros((3, count), F32), weights, np.zeros(count, half)]
    for step, g in enumerate(gradients):
        arrays[0] = g
        arrays = learn(kernels, schedule(kernels, step), arrays, factor=0.5)
        assert (arrays[0] == 0).all()
        np.testing.assert_array_equal(arrays[4], arrays[3].astype(half))
    halves = [0.5 * g.astype(float) for g in gradients]
    want = reference.adam(weights.astype(float), halves, 0.02, BETA1, BETA2, EPSILON)
    # A step is at most some 0.02, found in float32: 1 - 0.99 has lost 7 of its 24 digits.
    np.testing.assert_allclose(arrays[3], want, rtol=0, atol=19 * 0.02 * 2e-5)


def test_adam_decays_weights(kernels):
    weights = noise(100)
    arrays = [np.zeros(100, F32) for _ in range(3)] + [weights, weights]
    *_, after, _ = learn(kernels, schedule(kernels, 0), arrays, decay=0.1)
    gradients = [0.1 * weights.astype(float)]
    want = reference.adam(weights.astype(float), gradients, 0.02, BETA1, BETA2, EPSILON)
    np.testing.assert_allclose(after, want, rtol=0, atol=1e-6)


def test_sparse_adam_leaves_what_has_no_gradient(kernels):
    arrays = [noise(102, seed=k) for k in range(4)]
    arrays[2] = np.abs(arrays[2])
    arrays[0][:8] = 0  # whole groups of four
    arrays[0][::2] = 0
    arrays.append(arrays[3])
    rate = schedule(kernels, 5)
    after = learn(kernels, rate, arrays, decay=0.1, sparse=True)
    whole = learn(kernels, rate, arrays, decay=0.1)
    for a, b, c in zip(after[1:], arrays[1:], whole[1:], strict=True):
        np.testing.assert_array_equal(a[::2], b[::2])
        np.testing.assert_array_equal(a[:8], b[:8])
        np.testing.assert_array_equal(a[9::2], c[9::2])
        assert (c != b).all()


@pytest.mark.parametrize("step", [0, 1, 49, 99, 5000])
@pytest.mark.parametrize("progress", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("warmup", [0, 100])
def test_learning_rate(kernels, warmup, progress, step):
    rate = schedule(kernels, step, progress, 0.02, warmup, 0.1)
    warm = min(1.0, (step + 1) / warmup) if warmup else 1.0
    want = [0.02 * warm * 0.1**progress, 1 - BETA1 ** (step + 1), 1 - BETA2 ** (step + 1)]
    np.testing.assert_allclose(rate, want, rtol=2e-5)  # the bound above, for 1 - 0.99


@pytest.mark.parametrize("most", [1.0, 70.0, 1e30])  # the norm is 66
@pytest.mark.parametrize("parts", [1, 64, 5000])
def test_clip(kernels, parts, most):
    first, second = noise(70003), noise(50, seed=1)
    sums = np.zeros(parts, F32)
    for gradients in (first, second):
        before = sums
        sums, again = (
            kernels("radiance.training.adam.add_squares", gradients, out=[before]) for _ in range(2)
        )
        np.testing.assert_array_equal(sums, again)
    square = (first.astype(float) ** 2).sum() + (second.astype(float) ** 2).sum()
    np.testing.assert_allclose(sums.sum(dtype=float), square, rtol=1e-5)
    sums, factor = kernels("radiance.training.adam.clip", 0.25, most, out=[sums, ((1,), F32)])
    assert (sums == 0).all()
    norm = 0.25 * np.sqrt(square)
    np.testing.assert_allclose(factor, 0.25 * min(1.0, most / norm), rtol=1e-5)


def test_clip_of_nothing(kernels):
    _, factor = kernels(
        "radiance.training.adam.clip", 0.25, 1.0, out=[np.zeros(4, F32), ((1,), F32)]
    )
    assert factor[0] == 0.25


def test_advance(kernels):
    assert kernels("radiance.training.adam.advance", out=[number(41)])[0] == 42
