"""Laser lines: each method against NumPy, rendered lines, noise against its bound."""

import numpy as np
import pytest

import cvkern
from cvkern.filters.linear import gaussian_taps

F32, I32 = np.float32, np.int32
METHODS = ["steger", "center_of_mass", "peak"]


def rendered(rows, height=80, sigma=2.0, contrast=1.0):
    """Render a line that crosses column x at rows[x]."""
    y = np.arange(height)[:, None] - np.asarray(rows)
    return contrast * np.exp(-(y**2) / (2 * sigma**2))


def along(frames, axis):
    """See frames so that places lie along the second axis."""
    return frames if axis == 0 else frames.swapaxes(1, 2)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("half", [0, 2])
def test_find(kernels, axis, half, dtype):
    frames = np.random.default_rng(1).integers(0, 9, (3, 21, 300)).astype(dtype)
    seen = np.pad(along(frames, axis).astype(F32), ((0, 0), (half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(seen, 2 * half + 1, axis=1)
    want = windows.sum(axis=-1).argmax(axis=1)  # the first of equal sums
    got = kernels("structured_light.laser.find", frames, axis, half, out=[(want.shape, I32)])
    np.testing.assert_array_equal(got, want)


def test_find_nothing(kernels):
    frames = np.full((1, 5, 7), np.nan, F32)
    frames[0, :, 3] = 1
    got = kernels("structured_light.laser.find", frames, 0, 0, out=[((1, 7), I32)])
    np.testing.assert_array_equal(got, [[-1, -1, -1, 0, -1, -1, -1]])


@pytest.mark.parametrize("axis", [0, 1])
def test_peaks_and_centroids(kernels, axis):
    rng = np.random.default_rng(2)
    frames = rng.integers(0, 256, (2, 33, 41)).astype(np.uint8)
    seen = along(frames, axis)
    seen[1] = np.minimum(seen[1], 200)  # neighbours are equal
    places = seen.argmax(axis=1).astype(I32)
    places[0, 5] = -1
    none = places < 0
    out = [(places.shape, F32)] * 2
    position, strength = kernels("structured_light.laser.peaks", frames, axis, places, out=out)
    for n, line in np.ndindex(*places.shape):
        p, values = places[n, line], seen[n, :, line].astype(F32)
        if p < 0:
            assert np.isnan(position[n, line])
            continue
        after = p + np.append(values[p:] != values[p], True).argmax()
        a, b, c = values[max(p - 1, 0)], values[p], values[min(after, len(values) - 1)]
        bend = (b - a) + (b - c)
        shift = F32(0.5) * ((c - a) / bend) if bend > 0 else F32(0)
        assert position[n, line] == F32((p + after - 1) / 2) + shift
    np.testing.assert_array_equal(strength, np.where(none, 0, seen.max(axis=1)))

    radius = 4
    position, strength = kernels(
        "structured_light.laser.centroids", frames, axis, places, radius, out=out
    )
    for n, line in np.ndindex(*places.shape):
        p = places[n, line]
        if p < 0:
            assert np.isnan(position[n, line])
            continue
        low, high = max(0, p - radius), min(seen.shape[1], p + radius + 1)
        window = seen[n, low:high, line].astype(F32)
        weight = window - window.min()
        offset = F32(weight @ np.arange(low - p, high - p, dtype=F32)) / weight.sum()
        assert position[n, line] == F32(p) + offset  # sums of integers below 2^24 are exact
        assert strength[n, line] == np.ptp(window)


def test_ridges(kernels):
    """Against Steger's rule in float64, at the place where the search ends."""
    rows = 20 + 3 * np.sin(np.arange(50) / 9)
    frames = (200 * rendered(rows, 45)).astype(F32)[None]
    taps, curve = np.stack([gaussian_taps(1.7, order) for order in range(3)]), 0.15
    start = np.rint(rows).astype(I32)[None]
    start[0, ::3] += 2  # it finds its way
    position, strength = kernels(
        "structured_light.laser.ridges",
        frames,
        0,
        start,
        taps,
        1.0,
        curve,
        out=[((1, 50), F32)] * 2,
    )
    radius = taps.shape[1] // 2
    padded = np.pad(frames[0].astype(float), radius, mode="edge")
    for x in range(50):
        apart = []
        for p in np.rint(position[0, x]) + np.arange(-1, 2):  # one of them has told the place
            patch = padded[int(p) :, x:][: 2 * radius + 1, : 2 * radius + 1]
            g0, g1, g2 = taps.astype(float)
            gradient = np.array([g1 @ patch @ g0, g0 @ patch @ g1])
            mixed = g1 @ patch @ g1
            hessian = np.array([[g2 @ patch @ g0, mixed], [mixed, g0 @ patch @ g2]])
            values, vectors = np.linalg.eigh(hessian)
            t = -gradient @ vectors[:, 0] / values[0] / vectors[0, 0]
            if abs(t) < 0.76:
                place = p + t * (1 - curve * t**2)
                apart.append((abs(position[0, x] - place), abs(strength[0, x] + values[0])))
        # Sums of 225 products in float32, of values up to 200: 1e-4 of a bend of about 20.
        assert min(apart)[0] < 2e-4
        assert min(apart)[1] < 2e-3
    # Smoothing moves a line of curvature k by about k sigma^2 / 2: 3 / 81 * 1.7^2 / 2 = 0.054.
    np.testing.assert_allclose(position[0, 5:-5], rows[5:-5], rtol=0, atol=0.06)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("axis", [0, 1])
def test_rendered_lines(backend, method, axis):
    rows = np.stack([30 + 0.31 * np.arange(60), 55 - 0.2 * np.arange(60)])
    frames = np.stack([100 * rendered(r) for r in rows])
    if axis == 1:
        frames = frames.swapaxes(1, 2)
    found = cvkern.detect_laser_lines(frames, axis=axis, method=method)
    off = np.abs(found.positions - rows)[:, 8:-8]  # the ends of a slanted line are bent
    assert off.max() < {"steger": 0.004, "center_of_mass": 0.02, "peak": 0.03}[method]
    one = cvkern.detect_laser_lines(frames[0], axis=axis, method=method)
    np.testing.assert_array_equal(one.positions, found.positions[0])
    np.testing.assert_array_equal(one.strengths, found.strengths[0])
    # A slanted line is wider along a column: by 1 / cos of its angle, at most 1.05 here.
    assert np.abs(found.strengths[:, 8:-8] / 100 - 1).max() < 0.06


def test_saturated_lines(backend):
    """The middle of equal values, and a line that is cut off at its shoulders."""
    frame = np.zeros((40, 3), np.uint8)
    frame[7:10, 0] = frame[12:16, 1] = frame[:, 2] = 255
    found = cvkern.detect_laser_lines(frame, method="peak")
    np.testing.assert_array_equal(found.positions, [8, 13.5, 19.5])
    rows = np.random.default_rng(5).uniform(30, 50, 400)
    for contrast in (2, 4, 10):
        frame = np.minimum(np.rint(255 * rendered(rows, contrast=contrast)), 255).astype(np.uint8)
        found = cvkern.detect_laser_lines(frame, method="peak")
        off = found.positions - rows
        # Both ends are within a pixel of the true ones, so the middle is within half a pixel. The
        # values beside them halve what is left of that in the mean, from 0.29 if it were uniform.
        assert np.abs(off).max() < 0.5
        assert np.sqrt(np.mean(off**2)) < 0.15


def test_noise_against_the_bound(backend):
    """Noise of 2 % of the line's height: below the bound of a column that is taken by itself."""
    rng = np.random.default_rng(3)
    rows = 40 + rng.uniform(-5, 5) + 0.02 * np.arange(2000)
    frame = rendered(rows, 120) + rng.normal(0, 0.02, (120, 2000))
    bound = 0.02 * np.sqrt(2 * 2.0 / np.sqrt(np.pi))
    for method, most in (("steger", 0.5), ("center_of_mass", 3.0), ("peak", 8.0)):
        found = cvkern.detect_laser_lines(frame, method=method, sigma=2.0)
        off = (found.positions - rows)[10:-10]
        assert np.isfinite(off).all()
        assert np.sqrt(np.mean(off**2)) < most * bound, method


def test_columns_without_a_line_are_none(backend):
    rng = np.random.default_rng(4)
    frame = 100 * rendered(np.full(60, 22.3)) + rng.normal(0, 1, (80, 60))
    frame[:, 20:30] = rng.normal(0, 1, (80, 10))
    found = cvkern.detect_laser_lines(frame)
    assert np.isnan(found.positions[24:26]).all()
    assert np.isfinite(found.positions[:16]).all()
    assert np.isfinite(cvkern.detect_laser_lines(frame, threshold=0).positions).sum() > 50
    with pytest.warns(UserWarning, match="no line was found"):
        assert np.isnan(cvkern.detect_laser_lines(frame, threshold=1e6).positions).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 3, 4)])
def test_small_frames(backend, shape):
    frames = np.zeros(shape, np.uint8)
    for axis in (0, 1):
        found = cvkern.detect_laser_lines(frames, axis=axis)
        assert found.positions.shape == (*shape[:-2], shape[-1] if axis == 0 else shape[-2])
        assert np.isnan(found.positions).all()


@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("axis must be in [0, 1], got 2", {"axis": 2}),
        ("method must be one of ('peak', 'center_of_mass', 'steger'), got 'x'", {"method": "x"}),
        ("sigma must be >= 0.5 and finite, got 0.1", {"sigma": 0.1}),
        ("sigma must be in [0.5, 32], got 33", {"sigma": 33}),
        ("threshold must be >= 0 and finite, got -1", {"threshold": -1}),
    ],
)
def test_errors(no_kernel_runs, message, options):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        cvkern.detect_laser_lines(np.eye(9), **options)
    assert str(info.value) == message
