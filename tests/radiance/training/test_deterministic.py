"""Training that is equal from run to run on a GPU, with gradients added as integers."""

import numpy as np
import pytest

import cvkern
from cvkern.kernels.codes.radiance import Composited, Grid, March, Rays, Space
from cvkern.radiance import fit, make_scene
from tests.radiance import reference_radiance as reference
from tests.radiance.fields.test_hash import Trial
from tests.radiance.fields.test_layers import noise, number, places
from tests.radiance.fields.test_voxel import ALL, grid, outputs, rays
from tests.radiance.runs import FIELDS, interrupt, same

F32, I32, I64, U8, U32 = np.float32, np.int32, np.int64, np.uint8, np.uint32
UNIT, LIMIT = 2.0**-28, 2.0**16
GRIDS = np.array([4, 60], I32), np.array([0, 128, 1152], I32)  # with a place each, and hashed


@pytest.fixture
def exact(kernels):
    """Return the kernels, if they can add integers."""
    if (kernels.name, kernels.device) == ("warp", "cpu"):
        pytest.skip("adds in order")
    return kernels


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


# ------------------------------------------------------------------------------------------- sums


@pytest.mark.parametrize("count", [1, 3, 4, 1001])
def test_collect(kernels, count):
    rng, before = np.random.default_rng(0), noise(count)
    sums = rng.integers(-(2**50), 2**50, count, dtype=I64)
    sums[: count // 2] = 0
    left, after = kernels("radiance.training.adam.collect", out=[sums, before])
    assert not left.any()
    np.testing.assert_allclose(after, before + sums * UNIT, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(after[: count // 2], before[: count // 2])


def test_sums_of_a_table_have_no_order(exact):
    positions, d_features = places(3000), noise(3000, 4)
    before = np.random.default_rng(1).integers(-(2**40), 2**40, (GRIDS[1][-1], 2), dtype=I64)
    # With Warp in that of the same samples: those side by side in one cell may be added up first.
    order = np.random.default_rng(2).permutation(3000) if exact.name == "taichi" else slice(None)
    first, second = (
        exact("radiance.fields.hash.backward", positions[at], number(3000), *GRIDS, d_features[at],
              out=[before])
        for at in (slice(None), order)
    )  # fmt: skip
    np.testing.assert_array_equal(first, second)
    want = reference.hash_backward(positions, GRIDS, d_features)
    size = reference.hash_backward(positions, GRIDS, np.abs(d_features))
    # Weights in float32, and half a unit for each of at most 24 000 terms.
    error = np.abs((first - before) * UNIT - want)
    assert (error <= 1e-5 * size + 24000 * UNIT / 2).all()


def test_addends_are_cut_off(exact):
    """Where half precision ends: no number of them that a batch has can overflow."""
    positions = np.zeros((2**12, 3), F32)  # all of it goes to the first corner
    d_features = np.tile(np.array([1e30, -1e30, 0, 0], F32), (2**12, 1))
    sums = exact("radiance.fields.hash.backward", positions, number(2**12), *GRIDS, d_features,
                 out=[np.zeros((GRIDS[1][-1], 2), I64)])  # fmt: skip
    assert LIMIT <= sums[0, 0] * UNIT <= 2**12 * LIMIT
    assert sums[0, 1] == -sums[0, 0]
    assert not sums[1:].any()


def test_what_is_no_number_stays_so(exact):
    """However many there are of them, and whatever is added: a training that diverges shows."""
    for count in (1, 2, 64):
        positions, d_features = places(3000), noise(3000, 4)
        positions[:count], d_features[:] = positions[0], np.abs(d_features)
        d_features[:count, 0] = np.nan
        order = np.random.default_rng(count).permutation(3000)
        sums = exact("radiance.fields.hash.backward", positions[order], number(3000), *GRIDS,
                     d_features[order], out=[np.zeros((GRIDS[1][-1], 2), I64)])  # fmt: skip
        want = reference.hash_backward(positions, GRIDS, d_features)
        assert 1 <= np.isnan(want).sum() <= 8  # the corners of a cell
        left, found = exact(
            "radiance.training.adam.collect", out=[sums.ravel(), np.zeros(sums.size, F32)]
        )  # fmt: skip
        np.testing.assert_array_equal(np.isnan(found), np.isnan(want.ravel()))
        assert not left.any()


def test_collect_what_is_no_number(kernels):
    least = -(2**63)
    sums = np.array([least, least + 2**61, 2**63 - 2**61, 2**61, -(2**61), 0], I64)
    left, after = kernels("radiance.training.adam.collect", out=[sums, np.ones(6, F32)])
    np.testing.assert_array_equal(after, [np.nan] * 3 + [2.0**33, -(2.0**33), 1])  # rounded to 24
    assert not left.any()


def test_sums_of_a_grid_have_no_order(exact):
    density, color = grid(16, 9, 0.0)
    origins, directions = rays(200)
    bits = np.full(8**3 // 32, 2**32 - 1, U32)
    march = (
        Space(bits, 1, 8, False),
        March(0.1, 10.0, 1 / 16, 0.0, 0, False, 1, np.array([2], I32)),
        Grid(density, color, 9, ALL),
        1e-4,
    )
    gradients = [noise(*s, seed=k) for k, s in enumerate(((200, 3), (200,), (200,), (200,)))]

    def sums(at, dtype, gradients=gradients):
        along = Rays(origins[at], directions[at], np.array([200], I32)), *march
        seen = exact("radiance.fields.voxel.rays.render", *along, out=outputs(200))
        zeros = [np.zeros(density.shape, dtype), np.zeros(color.shape, dtype)]
        return exact(
            "radiance.fields.voxel.rays.render_backward",
            Composited(*(g[at] for g in gradients)),
            *along,
            Composited(*seen[:4]),
            seen[4],
            out=[*zeros, np.zeros(density.shape, U8)],
        )

    first = sums(slice(None), I64)
    second = sums(np.random.default_rng(3).permutation(200), I64)
    for a, b, c in zip(first, second, sums(slice(None), F32), strict=True):
        np.testing.assert_array_equal(a, b)
        if a.dtype == I64:
            most = np.abs(c).max()
            assert most > 0.05
            assert np.abs(a * UNIT - c).max() < 1e-5 * most  # some 100 terms, summed in float32

    broken = [g.copy() for g in gradients]
    broken[0][7] = np.nan
    for found, whole in zip(sums(slice(None), I64, broken)[:2], first[:2], strict=True):
        beyond = (found >= 2**62) | (found <= -(2**62))
        assert 0 < beyond.sum() < (whole != 0).sum()  # those of one ray


# ----------------------------------------------------------------------------------------- fields


def test_sums_give_the_gradients_of_a_field():
    with cvkern.use(backend="taichi"):
        plain, exact = Trial(), Trial()
        exact.field.table.make_deterministic(exact.rt)
        for a, b in zip(exact.slopes(), plain.slopes(), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5)
        assert not exact.rt.to_numpy(exact.field.table.sums).any()


@FIELDS
def test_nothing_changes_on_the_cpu(backend, scene, field):
    first, second = (fit(scene, field, steps=3, deterministic=on) for on in (False, True))
    assert same(first, second)
    assert second.field.gradient_scale == 1


@pytest.fixture
def gpu(backend):
    """Have everything run on a GPU."""
    warp = pytest.importorskip("warp")
    if not warp.is_cuda_available():
        pytest.skip("needs a CUDA device")
    with cvkern.use(device="cuda"):
        yield backend


@FIELDS
def test_training_is_equal_from_run_to_run(gpu, scene, field):
    options = {"steps": 60, "background": "learnt", "deterministic": True}
    first, second = (fit(scene, field, **options) for _ in range(2))
    assert same(first, second)
    np.testing.assert_array_equal(first.behind, second.behind)
    plain = fit(scene, field, steps=60, background="learnt")
    # The same training, but for the rounding of sums, which grows over the steps.
    assert abs(plain.training.marks[-1].test_psnr - first.training.marks[-1].test_psnr) < 2


@FIELDS
def test_training_that_goes_on_is_equal(gpu, scene, tmp_path, field):
    options = {"steps": 48, "deterministic": True}
    file = tmp_path / "model.npz"

    class Killed(BaseException):
        pass

    def kill():
        raise Killed

    with pytest.MonkeyPatch.context() as patch:
        interrupt(patch, 40, kill)
        with pytest.raises(Killed):
            fit(scene, field, checkpoint=file, save_every=1e-6, **options)
    on = fit(scene, field, checkpoint=file, resume=True, **options)
    assert same(on, fit(scene, field, **options))
