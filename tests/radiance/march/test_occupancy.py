"""The occupancy grid: random points in its cells, their densities, and the marked cells."""

import numpy as np
import pytest

from tests.radiance import reference_radiance as reference
from tests.radiance.march.test_steps import pack

F32, I32, U32 = np.float32, np.int32, np.uint32


def visit(kernels, number, count, cells=8, every=False, unbounded=False, seed=3, step=7, begin=0):
    return kernels(
        "radiance.march.occupancy.visit",
        cells,
        count,
        every,
        unbounded,
        seed,
        np.array([step], I32),
        begin,
        out=[((number,), I32), ((number, 3), F32)],
    )


@pytest.mark.parametrize("seed", [0, 1, 2**31 - 1, -5])
@pytest.mark.parametrize("step", [0, 1, 10**6])
def test_random_numbers_have_the_bits_of_the_definition(kernels, seed, step):
    begin, number, count = 100, 1000, 2 * 8**3
    numbers, points = visit(kernels, number, count, seed=seed, step=step, begin=begin)
    item = begin + np.arange(number)
    np.testing.assert_array_equal(numbers, reference.random_index(seed, step, item, 8, count))
    want = reference.in_cube(reference.random_points(numbers, 8, seed, step), False)
    # A number, the product with the size of the cell, two sums, each rounded once, within 2.
    np.testing.assert_allclose(points, want, rtol=0, atol=4 * 2**-23)


def test_random_numbers_are_uniform_and_independent(kernels):
    numbers, bins = 2**16, 64
    drawn = [visit(kernels, numbers, bins, seed=s, step=t)[0] for s, t in ((1, 0), (1, 1), (2, 0))]
    pairs = [drawn[0][:-1] * bins + drawn[0][1:]]  # pairs of one item and the next, step, seed
    pairs += [drawn[0] * bins + other for other in drawn[1:]]
    for values, size in [(d, bins) for d in drawn] + [(p, bins * bins) for p in pairs]:
        expected = len(values) / size
        chi2 = ((np.bincount(values, minlength=size) - expected) ** 2 / expected).sum()
        # About normal, of mean size and variance 2 size; the numbers are always the same.
        assert abs(chi2 - size) < 4 * np.sqrt(2 * size)


@pytest.mark.parametrize("unbounded", [False, True])
def test_visit_every_cell(kernels, unbounded):
    cells, levels = 4, 3
    count = levels * cells**3
    numbers, points = visit(
        kernels, 100, count, cells=cells, every=True, unbounded=unbounded, begin=count - 80
    )
    # Those behind the last are the last again.
    np.testing.assert_array_equal(numbers, np.minimum(count - 80 + np.arange(100), count - 1))
    inside = reference.random_points(numbers, cells, 3, 7)
    level, found = reference.cells_of(inside.astype(F32), levels, cells)
    own = level == numbers // cells**3  # the middle of an outer level is that of an inner one
    assert own.any()
    np.testing.assert_array_equal(found[own], numbers[own])
    np.testing.assert_allclose(
        points, reference.in_cube(inside, unbounded), rtol=0, atol=4 * 2**-21
    )


def test_visit_other_cells_in_the_next_batch(kernels):
    first, second = (visit(kernels, 500, 8**3, begin=begin)[0] for begin in (0, 500))
    assert (first != second).mean() > 0.9
    np.testing.assert_array_equal(visit(kernels, 1000, 8**3)[0], np.concatenate([first, second]))


def test_fade_and_raise(kernels):
    rng = np.random.default_rng(4)
    density = rng.random(300).astype(F32)
    faded = kernels("radiance.march.occupancy.fade", 0.75, out=[density])
    np.testing.assert_array_equal(faded, density * F32(0.75))
    visited = rng.integers(0, 100, 1000).astype(I32)  # each cell many times
    sigma = rng.random(1000).astype(F32)
    raised = kernels("radiance.march.occupancy.raise_to", visited, sigma, out=[density])
    want = density.copy()
    np.maximum.at(want, visited, sigma)
    np.testing.assert_array_equal(raised, want)


@pytest.mark.parametrize("least", [0.1, 10.0])
@pytest.mark.parametrize(("count", "parts"), [(64, 1024), (4096, 128), (4128, 100), (2**17, 50)])
def test_mark(kernels, count, parts, least):
    density = np.random.default_rng(5).random(count).astype(F32)
    found, limit, bits = kernels(
        "radiance.march.occupancy.mark", density, least,
        out=[((parts,), F32), ((1,), F32), ((count // 32,), U32)],
    )  # fmt: skip
    # Sums of up to 4096 numbers below 1, each rounded to 24 digits.
    np.testing.assert_allclose(found.sum(dtype=float), density.sum(dtype=float), rtol=1e-5)
    np.testing.assert_allclose(limit, min(least, density.mean(dtype=float)), rtol=1e-5)
    np.testing.assert_array_equal(bits, pack(density > limit))
