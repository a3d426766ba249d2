"""Shifted fringes: patterns, their decoding, noise against its bound."""

import imageio.v3 as iio
import numpy as np
import pytest

import cvkern
from cvkern.kernels.codes.structured_light import Decoded, Fringes
from tests.structured_light import reference_structured_light as reference
from tests.truth import truth

F32, U8 = np.float32, np.uint8


def waves(steps):
    turns = 2 * np.pi * np.arange(steps) / steps
    return np.stack([np.sin(turns), np.cos(turns)], axis=1).round(12).astype(F32) + F32(0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (33, 65)])
def test_decode(kernels, shape, dtype):
    """In every bit, of noise: any place, any fringe."""
    rng = np.random.default_rng(5)
    before = rng.integers(0, 2, shape).astype(U8)
    for frequencies, steps, begin in (((1, 8, 64), 4, 0), ((3,), 3, 2), ((1, 5.5), 7, 1)):
        frequencies = np.array(frequencies, F32)
        count = steps * len(frequencies)
        frames = rng.integers(0, 256, (begin + count, *shape)).astype(dtype)
        real = shape, F32
        got = kernels(
            "structured_light.phase.decode", frames, begin,
            Fringes(frequencies, waves(steps), 640, 30.0, begin > 0),
            out=[Decoded(real, real, real, before)],
        )  # fmt: skip
        want = reference.phases(frames[begin:], frequencies, waves(steps), 640)
        for a, b in zip(got, want, strict=False):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(got[3], (want[2] > 30) & ((begin == 0) | (before != 0)))


def test_accept(kernels):
    a, b = np.random.default_rng(6).random((2, 5, 70), F32)
    a[0, 0] = np.nan
    got = kernels("structured_light.phase.accept", a, b, 0.5, out=[((5, 70), U8)])
    np.testing.assert_array_equal(got, (a > 0.5) & (b > 0.5))


@pytest.mark.parametrize("axes", [["columns"], ["rows"], ["rows", "columns"]])
def test_the_projector_reads_its_own_patterns(backend, axes):
    shape, frequencies, steps = (48, 75), (1, 6, 24), 5
    seen = cvkern.phase_shift_patterns(shape, frequencies, steps, axes=axes)
    found = cvkern.decode_phase_shift(seen, shape, frequencies, steps, axes=axes)
    rows, columns = np.indices(shape)
    for name, want in (("columns", columns), ("rows", rows)):
        got = getattr(found, name)
        if name in axes:
            # Values rounded to 1/255: a phase error of at most sqrt(2 / 5) of 1/255 radians.
            size = shape[name == "columns"]
            assert np.abs(got - want).max() < size / 24 / (2 * np.pi) / 255
        else:
            assert got is None
    assert found.valid.all()
    np.testing.assert_allclose(found.modulation, 127.5, rtol=0.01)


def test_noise_is_that_of_the_bound(backend):
    """The standard deviation is s sqrt(2 / N) / B in phase, and no fringe is missed."""
    shape, frequencies, steps, sigma = (200, 640), (1, 8, 64), 4, 5.0
    rng = np.random.default_rng(7)
    pattern = cvkern.phase_shift_patterns(shape, frequencies, steps, axes=["columns"])
    assert pattern.flags.c_contiguous
    seen = pattern * F32(0.8) + rng.normal(0, sigma, pattern.shape).astype(F32)
    found = cvkern.decode_phase_shift(seen, shape, frequencies, steps, axes=["columns"])
    off = found.columns - np.arange(shape[1])
    bound = sigma * np.sqrt(2 / steps) / (0.8 * 127.5) / (2 * np.pi) * shape[1] / 64
    assert np.abs(off).max() < 8 * bound  # a missed fringe is 10 columns, 113 times the bound
    assert 0.95 < off.std() / bound < 1.05
    assert abs(off.mean()) < 0.05 * bound


def test_a_projectors_gamma_is_undone(backend):
    shape = (8, 200)
    for gamma in (1.0, 2.2):
        lights = (cvkern.phase_shift_patterns(shape, (1, 10), 3, gamma=gamma) / 255) ** 2.2
        found = cvkern.decode_phase_shift(lights, shape, (1, 10), 3)
        off = np.abs(found.columns - np.arange(200)).max()
        assert (off < 0.1) == (gamma == 2.2)  # three steps cannot cancel the second harmonic


def test_a_projectors_table_is_undone():
    """One that is black below a value, white above another, and bent between."""
    rise = np.linspace(-0.2, 1.1, 256).clip(0, 1)
    table = 7 + 90 * (rise**2.2 + 0.5 * rise)
    patterns = cvkern.phase_shift_patterns((8, 200), (1, 10), 3, gamma=table)
    found = cvkern.decode_phase_shift(table[patterns], (8, 200), (1, 10), 3)
    # Light is off by half a step of the table, at most 0.011 of the amplitude: 0.011 radians.
    assert np.abs(found.columns - np.arange(200)).max() < 0.011 / (2 * np.pi) * 200 / 10
    one, other = (
        cvkern.phase_shift_patterns((8, 200), gamma=g).astype(int) for g in (1.0, np.arange(256))
    )
    assert np.abs(one - other).max() <= 1  # light in the middle of two values is that of either
    assert (one == other).mean() > 0.8
    for wrong, message in (
        (np.ones(255), r"gamma must be a number or have shape \(256,\), got \(255,\)"),
        (np.ones(256), "gamma must be finite and rise, got a table that does not"),
        (table[::-1], "gamma must be finite and rise, got a table that does not"),
    ):
        with pytest.raises(ValueError, match=message):
            cvkern.phase_shift_patterns((8, 200), gamma=wrong)


def test_the_threshold_is_a_share_of_the_brightest(backend):
    shape = (30, 64)
    pattern = cvkern.phase_shift_patterns(shape, (1, 4), 4).astype(F32)
    pattern[:, 10:20] *= 0.03
    found = cvkern.decode_phase_shift(pattern, shape, (1, 4), 4)
    assert not found.valid[10:20].any()
    assert found.valid[:10].all()
    assert cvkern.decode_phase_shift(pattern, shape, (1, 4), 4, threshold=1).valid.all()


def test_three_steps_of_a_real_scene(backend):
    folder = truth("structured_light") / "three_phase_zebra"
    images = np.stack([iio.imread(path) for path in sorted(folder.glob("*.png"))])
    if images.ndim == 4:
        images = images.mean(axis=-1)
    found = cvkern.decode_phase_shift(images, (576, 576), [20], 3, axes=["columns"], threshold=10)
    assert found.valid.mean() == pytest.approx(0.48, abs=0.02)


IMAGES = np.zeros((12, 4, 4))


@pytest.mark.parametrize(
    ("message", "arguments", "options"),
    [
        (
            "images must be 24 for 3 frequencies of 4 steps and columns and rows, got 12",
            (IMAGES, (4, 4)),
            {},
        ),
        ("steps must be in [3, 64], got 2", (IMAGES, (4, 4), [1], 2), {}),
        ("frequencies must rise, got (2.0, 1.0)", (IMAGES, (4, 4), [2, 1]), {}),
        ("frequencies must be > 0, got 0", (IMAGES, (4, 4), [0]), {}),
        ("frequencies must be a sequence of numbers, got 3", (IMAGES, (4, 4), 3), {}),
        ("threshold must be >= 0 and finite, got -1", (IMAGES, (4, 4), [1], 6), {"threshold": -1}),
    ],
)
def test_errors(no_kernel_runs, message, arguments, options):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        cvkern.decode_phase_shift(*arguments, **options)
    assert str(info.value) == message


def test_every_so_many_pixels(kernels):
    src = np.arange(77, dtype=np.float32).reshape(7, 11)
    out = [((3, 4), np.float32)]
    found = kernels("transform.pyramids.thin", src, 3, out=out)
    np.testing.assert_array_equal(found, src[::3, ::3])


def test_a_pixel_needs_strong_fringes_along_both_axes(backend):
    images = cvkern.phase_shift_patterns((12, 20), (1, 4)).astype(np.float32)
    half = len(images) // 2
    images[:half, 2:4] *= 0.01  # those that tell the columns
    images[half:, 7:9] *= 0.01  # those that tell the rows
    found = cvkern.decode_phase_shift(images, (12, 20), (1, 4), threshold=20)
    want = np.ones((12, 20), bool)
    want[2:4] = want[7:9] = False
    np.testing.assert_array_equal(found.valid, want)
