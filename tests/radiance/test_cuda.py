"""Radiance fields on a GPU, against the CPU; the caller's arrays."""

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.kernels.codes.radiance import Rays, Seen
from cvkern.radiance import (
    Composite,
    PlanesField,
    composite_rays,
    composite_rays_backward,
    evaluate,
    fit,
    make_scene,
    march,
)
from cvkern.radiance.rendering import owned
from profiling.experiments.wild_quality import changed
from tests.on_cuda import LIBRARIES, give, take
from tests.radiance import test_distractors, test_transient
from tests.radiance.fields import test_planes
from tests.radiance.fields.test_hash import Trial
from tests.radiance.runs import GRID, TINY, same
from tests.radiance.test_primitives_compositing import bundle, draw
from tests.radiance.training import test_appearance, test_embedding

pytestmark = pytest.mark.usefixtures("gpu")


@pytest.mark.parametrize("unbounded", [False, True])
def test_a_hash_field_is_that_of_the_cpu(unbounded, backend):
    # One after the other: Taichi works on the device that was asked for last.
    answers = []
    for device in ("cpu", "cuda"):
        with cvkern.use(backend=backend, device=device):
            trial = Trial(unbounded=unbounded)
            answers.append((trial.look(), trial.slopes(), trial.field.taken()))
    (here, slopes_here, taken_here), (there, slopes_there, taken_there) = answers
    # Features, weights and what passes through layers have 11 digits with Warp; five layers.
    exact = backend == "taichi"
    for got, want in zip(there, here, strict=True):
        np.testing.assert_allclose(
            got, want, rtol=1e-4 if exact else 0.03, atol=1e-4 if exact else 0.03
        )
    for got, want in zip(slopes_there, slopes_here, strict=True):
        off = np.linalg.norm(got - want) / np.linalg.norm(want)
        assert off < (1e-3 if exact else 0.05)
    assert taken_there == taken_here  # the same cells, whatever the precision


@pytest.mark.parametrize("unbounded", [False, True])
def test_a_hash_field_sees_what_it_does_on_the_cpu(unbounded, backend, monkeypatch):
    answers = []
    for device, room in (("cpu", 0), ("cuda", 2**16), ("cuda", 100)):
        monkeypatch.setattr(march, "VIEW_ROOM", room)  # on a GPU
        with cvkern.use(backend=backend, device=device):
            answers.append(Trial(unbounded=unbounded).see())
    bound = 1e-4 if backend == "taichi" else 0.03  # see above
    for here, wide, narrow in zip(*answers, strict=True):
        np.testing.assert_array_equal(narrow, wide)  # the same sums in the same order
        np.testing.assert_allclose(wide, here, rtol=bound, atol=bound)


def test_planes_and_their_gradients_are_those_of_the_cpu(backend):
    answers = []
    for device in ("cpu", "cuda"):
        with cvkern.use(backend=backend, device=device):
            rt, case = runtime(), test_planes.Case()
            texels = owned(rt, case.texels.astype(np.float32))
            seen = test_planes.seen_by(rt, case, texels)
            sides = test_planes.shine_gradients(rt, case)
            answers.append([*map(rt.to_numpy, seen), test_planes.gradient(rt, case), *sides])
    for here, there in zip(*answers, strict=True):
        np.testing.assert_allclose(there, here, atol=test_planes.CLOSE)


def test_planes_of_8_bits_are_those_of_the_cpu(backend):
    """Fewer rays than a block has threads, and more; on CUDA Warp has native code."""
    answers = []
    case = test_planes.Case()
    words = np.round(255 * case.texels).astype(np.uint8).view("<u4")[..., 0].astype(np.uint32)
    for device in ("cpu", "cuda"):
        with cvkern.use(backend=backend, device=device):
            rt = runtime()
            rays, planes = case.arrays(rt)
            from_, to = (owned(rt, np.tile(rt.to_numpy(a), (10, 1))) for a in rays[:2])
            rays = Rays(from_, to, owned(rt, np.array([390], np.int32)))
            for stop, row in ((0.0, 0), (0.5, 0), (0.0, 39), (0.5, 40)):
                seen = Seen(rt.zeros((400, 3)), rt.zeros((400,)), rt.zeros((400,)))
                rt.radiance.fields.planes.rays.render(
                    rays, planes, owned(rt, words), None, stop, row, seen
                )
                answers.append([rt.to_numpy(a).copy() for a in seen])
    for here, there in zip(answers[:4], answers[4:], strict=True):
        assert not there[1][390:].any()
        for one, two in zip(here, there, strict=True):
            # A weight of 1 / 256 that is rounded the other way moves a sample by as much.
            np.testing.assert_allclose(two, one, atol=0.02)
            assert np.abs(two - one).mean() < 1e-5


def test_large_planes_of_8_bits_are_those_of_the_cpu(backend):
    """Blocks of rays see parts that are away from the borders, at them, and empty."""
    rng, shape, answers = np.random.default_rng(0), (11, 90, 120), []
    opacity = rng.integers(0, 100, (*shape, 1))
    texels = np.concatenate((rng.integers(0, 256, (*shape, 3)) * opacity // 255, opacity), axis=3)
    texels[3:7, 30:60, 40:] = 0
    words = texels.astype(np.uint8).view("<u4")[..., 0].astype(np.uint32)
    at = np.stack(np.meshgrid(np.arange(128), np.arange(96), (1,)), axis=-1).reshape(-1, 3)
    ahead = (at - (60, 45, 0)) / (100, 100, 1)
    ahead[:, :2] += 0.02 * ahead[:, 1::-1]  # turned a little
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    eyes = np.broadcast_to(np.array([0.03, -0.02, 0.1], np.float32), ahead.shape)
    place = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 100, 100, 59.5, 44.5]
    place = np.concatenate((place, np.linspace(1, 0.2, shape[0]))).astype(np.float32)
    for device in ("cpu", "cuda"):
        with cvkern.use(backend=backend, device=device):
            rt = runtime()
            from_, to = (owned(rt, a.astype(np.float32)) for a in (eyes, ahead))
            rays = Rays(from_, to, owned(rt, np.array([len(at)], np.int32)))
            for row in (0, 128):
                seen = Seen(*(rt.zeros((len(at), *tail)) for tail in ((3,), (), ())))
                rt.radiance.fields.planes.rays.render(
                    rays, owned(rt, place), owned(rt, words), None, 1 / 255, row, seen
                )
                answers.append([rt.to_numpy(a).copy() for a in seen])
    for here, there in zip(answers[:2], answers[2:], strict=True):
        assert here[1].min() == 0 < 0.9 < here[1].max()
        for one, two in zip(here[:2], there[:2], strict=True):
            # Units for textures round places to 1 / 256 of a texel along both axes, and others at
            # other places; neighbouring texels differ by up to 0.4, and 11 samples add up.
            np.testing.assert_allclose(two, one, atol=0.015)
            assert np.abs(two - one).mean() < 1e-3


def test_fixed_point_sums_of_planes_are_equal_in_every_run(backend):
    """40 rays are repeated 100 times, so that many threads add to a texel."""
    found = []
    with cvkern.use(backend=backend, device="cuda"):
        rt, case = runtime(), test_planes.Case()
        rays, planes = case.arrays(rt)
        from_, to = (owned(rt, np.tile(rt.to_numpy(a), (100, 1))) for a in rays[:2])
        rays = Rays(from_, to, owned(rt, np.array([4000], np.int32)))
        texels = owned(rt, case.texels.astype(np.float32))
        seen = Seen(rt.zeros((4000, 3)), rt.zeros((4000,)), rt.zeros((4000,)))
        rt.radiance.fields.planes.rays.render(rays, planes, texels, None, 0.0, 0, seen)
        for _ in range(3):
            sums = rt.zeros(case.texels.shape, np.int64)
            rt.radiance.fields.planes.rays.render_backward(
                seen, rays, planes, texels, None, 0.0, seen, sums, None
            )
            found.append(rt.to_numpy(sums).copy())
    assert found[0].any()
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])
    with cvkern.use(backend=backend, device="cuda"):
        one, two = (test_planes.shine_gradients(runtime(), case, np.int64) for _ in "ab")
    for first, again in zip(one, two, strict=True):
        assert first.any()
        np.testing.assert_array_equal(first, again)


def test_colours_in_the_light_of_photographs(backend):
    with cvkern.use(backend=backend, device="cuda"):
        check = test_appearance
        for test in (
            check.test_colours_are_mapped,
            check.test_gradients_are_central_differences,
        ):
            test()


def test_photographs_lights_as_inputs(backend, monkeypatch):
    with cvkern.use(backend=backend, device="cuda"):
        test_embedding.test_gradients_are_summed_by_photographs()
        for field in (test_embedding.FLAT, test_embedding.DEEP):
            test_embedding.test_gradients_are_central_differences(field, None, monkeypatch)
    if backend == "warp":
        scene = changed(make_scene(train=16, test=2, size=24), "color")
        options = {"steps": 300, "progress": False, "deterministic": True}
        with cvkern.use(backend=backend, device="cuda"):
            one, two = (fit(scene, TINY, appearance="embedding", **options) for _ in "ab")
            plain = fit(scene, TINY, steps=300, progress=False)
            assert evaluate(one, scene).psnr.mean() > evaluate(plain, scene).psnr.mean() + 1
        assert same(one, two)
        np.testing.assert_array_equal(one.appearances, two.appearances)


def test_heads_and_weights_of_photographs(backend):
    answers = []
    for device in ("cpu", "cuda"):
        with cvkern.use(backend=backend, device=device):
            answers.append(test_transient.solved(test_transient.Case()))
            if device == "cuda":
                test_distractors.test_weights_are_probabilities()
                test_distractors.test_patches_are_averaged_with_their_neighbours()
                one, two = (
                    test_transient.solved(test_transient.Case(), sums=np.int64)[4] for _ in "ab"
                )
                np.testing.assert_array_equal(one, two)
                assert one.any()
    for here, there in zip(*answers, strict=True):  # sums of some 100 products up to 100
        np.testing.assert_allclose(there, here, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("way", ["robust", "transient"])
def test_crowds_are_told_from_the_scene(way):
    clean = make_scene(train=20, test=3, size=32)
    wild, options = changed(clean, "both"), {"steps": 400, "progress": False, way: True}
    with cvkern.use(backend="warp", device="cuda"):
        plain = fit(wild, GRID, steps=400, progress=False)
        one, two = (
            fit(wild, GRID, appearance="affine", deterministic=True, **options) for _ in "ab"
        )
        assert evaluate(one, wild).psnr.mean() > evaluate(plain, wild).psnr.mean() + 2
    assert same(one, two)
    for name, values in one.extra.items():
        np.testing.assert_array_equal(two.extra[name], values)


def test_planes_learn_in_changing_light():
    scene = changed(make_scene(train=12, test=2, size=48, layout="forward"), "color")
    field, options = PlanesField(planes=12, rays=1024), {"steps": 100, "progress": False}
    with cvkern.use(backend="warp", device="cuda"):
        plain = fit(scene, field, **options)
        one, two = (
            fit(scene, field, appearance="affine", deterministic=True, **options) for _ in "ab"
        )
        assert evaluate(one, scene).psnr.mean() > evaluate(plain, scene).psnr.mean() + 1
    np.testing.assert_array_equal(one.appearances, two.appearances)
    for name, values in one.field.state().items():
        np.testing.assert_array_equal(two.field.state()[name], values)


def test_a_gpu_has_memory_left(backend):
    with cvkern.use(backend=backend, device="cuda"):
        assert 2**20 < runtime().free_memory() < 2**40


@pytest.mark.parametrize("library", ["numpy", *LIBRARIES])
def test_compositing_of_the_callers_arrays(library, backend):
    samples, gradients = bundle(100), draw(100)
    want = composite_rays(*samples)
    want_slopes = composite_rays_backward(Composite(*gradients), *samples)
    place = "cuda" if library == "numpy" else "cpu"

    def put(array):
        return array if library == "numpy" else give(library, array)

    def compare(got, want, atol):
        for a, b in zip(got, want, strict=True):
            assert type(a) is type(given[0])
            host = a if library == "numpy" else take(a)
            np.testing.assert_allclose(host, b, rtol=1e-4, atol=atol)

    given, incoming = [put(a) for a in samples], Composite(*(put(a) for a in gradients))
    with cvkern.use(device=place):
        # Sums of up to 200 weights, each an exponential of its device, rounded to 24 digits.
        compare(composite_rays(*given), want, 200 * 2.0**-23)
        # Slopes are weights by lengths up to 0.01 and distances up to 2, of gradients up to 4.
        compare(composite_rays_backward(incoming, *given), want_slopes, 1e-4)
        with pytest.raises(ValueError, match="spans must be rows of the"):
            composite_rays(given[0][:9], given[1][:9], given[2][:9], given[3])


@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_captured_compositing_follows_its_samples(library):
    samples = bundle(100)
    given = [give(library, a) for a in samples]
    incoming = Composite(*(give(library, a) for a in draw(100)))
    with cvkern.use(backend="warp"):
        with pytest.raises(ValueError, match="a value needed on the host"):
            cvkern.capture(composite_rays, *given)
        replay = cvkern.capture(composite_rays, *given, check=False)
        slopes = cvkern.capture(composite_rays_backward, incoming, *given, check=False)
        for factor in (1.0, 0.5, 2.0):
            given[0][...] = give(library, np.float32(factor) * samples[0])
            plain = *composite_rays(*given), *composite_rays_backward(incoming, *given)
            for a, b in zip((*replay(), *slopes()), plain, strict=True):
                np.testing.assert_array_equal(take(a), take(b))
