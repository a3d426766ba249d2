"""What splats do in training beside gradients: they are relocated, wander, and see photographs."""

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.kernels.codes.splats import Draw, Splats
from cvkern.radiance.rendering import owned
from cvkern.radiance.splats.relocation import MOST_COPIES, relocated, shared
from tests.radiance.fields.reference_splats import rotation
from tests.radiance.reference_radiance import random_bits


def test_copies_hide_as_much_and_look_alike():
    """Along a line through the middle n copies hide o; beside it the light is about the same."""
    opacity = np.array([0.05, 0.5, 0.9, 0.99, 0.7])
    copies = np.array([2, 3, 2, 20, 200])
    logits, growth = shared(opacity, copies)
    n = np.minimum(copies, MOST_COPIES)
    less = 1 / (1 + np.exp(-logits))
    kept = 1 - (1 - less) ** n
    np.testing.assert_allclose(kept[:4], opacity[:4], rtol=1e-9)
    # The light that is stopped along a line beside, integrated over the distance, is kept.
    x = np.linspace(-12, 12, 100001)
    for k in range(4):
        one = opacity[k] * np.exp(-(x**2) / 2)
        many = 1 - (1 - less[k] * np.exp(-(x**2) / (2 * np.exp(2 * growth[k])))) ** n[k]
        assert many.sum() == pytest.approx(one.sum(), rel=1e-6)


def test_faded_splats_are_relocated():
    opacities = np.array([0.001, 0.9, 0.005, 0.3, 0.002, 0.6])
    rows, numbers, count = relocated(opacities, 7, 100)
    assert count == 3
    np.testing.assert_array_equal(rows[:3, 0], [0, 2, 4])
    assert set(rows[:3, 1]) <= {1, 3, 5}
    np.testing.assert_array_equal(rows[3:, 0], rows[3:, 1])
    assert set(rows[3:, 0]) == set(rows[:3, 1])
    assert numbers.shape == rows.shape
    again = relocated(opacities, 7, 100)
    np.testing.assert_array_equal(rows, again[0])
    many = relocated(np.repeat([0.001, 0.9, 0.3], 4000), 1, 1)
    drawn = np.bincount(many[0][: many[2], 1] // 4000, minlength=3)
    assert drawn[1] / drawn[2] == pytest.approx(3, rel=0.15)
    assert relocated(np.array([0.001]), 1, 1)[2] == 0


def test_copies_hide_as_much_as_their_original_did():
    """Eight copies of one splat, with the original: 1 - (1 - o')^8 = o."""
    _, numbers, count = relocated(np.array([0.9] + 7 * [0.001]), 3, 5)
    assert count == 7
    opacity = 1 / (1 + np.exp(-numbers[:, 0].astype(np.float64)))
    np.testing.assert_allclose(1 - (1 - opacity) ** 8, 0.9, rtol=1e-5)


def rows_of(rt, splats):
    return Splats(*(rt.to_numpy(a).astype(np.float64) for a in splats))


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("more", [9, 0])
def test_learning_kernels(more):
    rt, rng, count = runtime(), np.random.default_rng(2), 500
    shapes = (count, 3), (count, 4), (count, 3), (count, 1), (count, 3), (count, more or 1)
    if not more:
        shapes = (*shapes[:5], (1, 1))
    values, mean, square, slopes = (
        Splats(*(owned(rt, rng.normal(size=s).astype(np.float32)) for s in shapes))
        for _ in range(4)
    )
    rt.write(values.opacities, np.full((count, 1), -7, np.float32))
    kernels = rt.radiance.fields.splats.learning
    before, given = rows_of(rt, values), rows_of(rt, slopes)
    kernels.restrain(values, 0.5, 0.25, slopes)
    after = rows_of(rt, slopes)
    o = 1 / (1 + np.exp(-before.opacities))
    np.testing.assert_allclose(after.opacities, given.opacities + 0.5 * o * (1 - o), atol=1e-6)
    np.testing.assert_allclose(
        after.scales, given.scales + 0.25 * np.exp(before.scales), rtol=1e-5, atol=1e-5
    )
    rate, step = owned(rt, np.array([0.1, 1, 1], np.float32)), owned(rt, np.array([3], np.int32))
    kernels.wander(rate, 2.0, 5, step, values)
    moved = rows_of(rt, values).means - before.means
    share = 0.2 / (1 + np.exp(100 * (o - 0.005)))
    # In units of each splat's axes, the moves are normal numbers.
    turns = np.stack([rotation(q / np.linalg.norm(q)) for q in before.turns])
    plain = np.einsum("nj,njk->nk", moved, turns) / share / np.exp(2 * before.scales)
    assert abs(plain.mean()) < 0.1
    assert plain.std() == pytest.approx(1, abs=0.06)
    halves = [
        random_bits(5, 3, np.arange(count), which + k).astype(np.int64) >> shift & 0xFFFF
        for which in (Draw.X, Draw.Y, Draw.Z) for k in range(2) for shift in (0, 16)
    ]  # fmt: skip
    wanted = (np.reshape(halves, (3, 4, count)).sum(axis=1).T - 131070) * 3**0.5 / 65536
    wanted = np.einsum("nj,njk->nk", wanted, turns)
    # These splats move by up to 5, where float32 has steps of 5e-7, and in units of 0.05 at least.
    unit = share * np.exp(2 * before.scales)
    large = (unit > 0.05).all(axis=1) & (unit < 1).all(axis=1)
    assert large.sum() > 20
    np.testing.assert_allclose(plain[large], wanted[large], atol=2e-5)
    kernels.wander(rate, 2.0, 5, step, values)
    np.testing.assert_allclose(
        rows_of(rt, values).means - before.means, 2 * moved, rtol=1e-3, atol=1e-5
    )
    rt.write(values.opacities, np.full((count, 1), 5, np.float32))
    still = rows_of(rt, values)
    kernels.wander(rate, 2.0, 5, step, values)
    np.testing.assert_array_equal(rows_of(rt, values).means, still.means)
    rows = np.array([[4, 9], [7, 9], [2, 3]], np.int32)
    numbers = np.array([[1, 0.5], [2, -0.5], [3, 0]], np.float32)
    kernels.relocate(owned(rt, rows), owned(rt, numbers), values, mean, square)
    found, moments = rows_of(rt, values), [rows_of(rt, moment) for moment in (mean, square)]
    for name in ("means", "turns", "colors") + (("sides",) if more else ()):
        wanted = getattr(still, name).copy()
        wanted[rows[:, 0]] = wanted[rows[:, 1]]
        np.testing.assert_array_equal(getattr(found, name), wanted)
        for moment in moments:
            assert not getattr(moment, name)[rows[:, 0]].any()
            assert getattr(moment, name)[rows[:, 1]].all()
    np.testing.assert_allclose(found.scales[4], still.scales[9] + 0.5, rtol=1e-6)
    np.testing.assert_array_equal(found.opacities[[4, 7, 2], 0], [1, 2, 3])


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("channels", [3, 4])
def test_photographs_take_turns(channels):
    rt, rng = runtime(), np.random.default_rng(0)
    images = rng.integers(0, 256, (5 * 12, channels), np.uint8)
    seen = []
    for step in range(5):
        view, at = rt.zeros((1,), np.int32), owned(rt, np.array([step], np.int32))
        targets, places = rt.zeros((12, 4)), [rt.zeros((12,), np.int32) for _ in range(2)]
        rt.radiance.fields.splats.batches.photograph(
            owned(rt, images), 3, 11, at, view, targets, *places
        )
        number = int(rt.to_numpy(view)[0])
        assert number == (3 * step + 11) % 5
        wanted = images[12 * number : 12 * number + 12] / np.float32(255)
        found = rt.to_numpy(targets)
        np.testing.assert_allclose(found[:, :channels], wanted, rtol=1e-6)
        assert channels == 4 or (found[:, 3] == 1).all()
        assert (rt.to_numpy(places[0]) == number).all()
        np.testing.assert_array_equal(rt.to_numpy(places[1]), np.arange(12))
        seen.append(number)
    assert sorted(seen) == list(range(5))


@pytest.mark.usefixtures("backend")
def test_pixels_that_are_left_out():
    rt, rng, count = runtime(), np.random.default_rng(0), 40
    masks = rng.integers(0, 2, (3, count)).astype(np.uint8)
    before = [rng.normal(size=s).astype(np.float32) for s in ((count,), (count, 3), (count,),
                                                              (count, 3))]  # fmt: skip
    arrays = [owned(rt, a) for a in before]
    rt.radiance.fields.splats.batches.leave_out(
        owned(rt, masks.ravel()), owned(rt, np.array([1], np.int32)), *arrays
    )
    out = masks[1] == 0
    for found, given, value in zip(arrays, before, (-1, 0, 0, 0), strict=True):
        given[out] = value
        np.testing.assert_array_equal(rt.to_numpy(found), given)
