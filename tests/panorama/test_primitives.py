"""Primitives of panoramas against NumPy and SciPy."""

import numpy as np
import pytest

from cvkern.kernels.codes.panorama import FAR, NOBODY, OUTSIDE, Part
from tests.panorama import reference_panorama as reference
from tests.primitives import F32, I32, U8, noise

SHAPE = 14, 22
MATRIX = np.array([[15.0, 3, 9], [-2, 14, 8], [0.1, 0.05, 1]])


LENSES = [0.0, -0.004, 0.01]


def tables(height, width):
    """Return a cylinder's tables, which look beyond the image and behind its camera."""
    x, y = np.linspace(-1.9, 1.9, width), np.linspace(-0.7, 0.8, height)
    return np.stack((np.sin(x), np.cos(x)), 1), np.stack((np.ones_like(y), y), 1)


def camera(matrix, lens):
    return np.append(matrix, lens).reshape(1, 10)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(("dtype", "channels"), [(U8, 3), (F32, 1)])
def test_project(kernels, dtype, channels, lens):
    image = np.random.default_rng(0).integers(0, 256, (17, 20, channels)).astype(dtype)
    columns, rows = tables(*SHAPE)
    gains = np.linspace(0.8, 1.2, channels, dtype=F32)
    values, weights = kernels(
        "panorama.warping.project", image, camera(MATRIX, lens), columns, rows, gains,
        out=[((channels, *SHAPE), F32), (SHAPE, F32)],
    )  # fmt: skip
    at = reference.places(MATRIX, columns, rows, lens, (17, 20))
    # Rounding of float32: 2^-24 of 300, a few times.
    np.testing.assert_allclose(values, reference.samples(image, at, gains), rtol=0, atol=1e-4)
    np.testing.assert_allclose(weights, reference.weights(at, 17, 20), rtol=1e-6)
    assert 0 < (weights > 0).mean() < 1


def test_claim_and_bound(kernels):
    columns, rows = tables(*SHAPE)
    matrices = np.stack((MATRIX, MATRIX @ [[1, 0, 0.1], [0, 1, 0], [-0.1, 0, 1]], MATRIX))
    sides = np.array([[17, 20], [17, 20], [40, 60]], I32)
    coarse = np.random.default_rng(1).integers(-1, 3, (4, 5)).astype(I32)
    x, y = (np.arange(n, dtype=I32) * k // n for n, k in ((SHAPE[1], 5), (SHAPE[0], 4)))
    names = np.array([0, 1], I32)
    cameras = np.concatenate([camera(m, 0.004) for m in matrices])
    labels = kernels(
        "panorama.warping.claim", cameras, sides, names, columns, rows, coarse,
        x, y, out=[(SHAPE, I32)],
    )  # fmt: skip
    seen = [
        reference.places(matrix, columns, rows, 0.004, side)
        for matrix, side in zip(matrices, sides, strict=True)
    ]
    weights = np.stack([reference.weights(at, *s) for at, s in zip(seen, sides, strict=True)])
    wished = coarse[y[:, None], x]
    granted = np.take_along_axis(weights, wished.clip(0)[None], 0)[0] > 0
    asked = np.where(weights[:2].max(axis=0) > 0, weights[:2].argmax(axis=0), NOBODY)
    want = np.where((wished >= 0) & granted, wished, asked)
    np.testing.assert_array_equal(labels, want)
    assert set(np.unique(want)) == {-1, 0, 1, 2}
    bounds = np.tile(np.array([99, 99, -1, -1], I32), (4, 1))
    found = kernels("panorama.warping.bound", labels, out=[bounds])
    for n in range(3):
        there = np.argwhere(labels == n)
        assert found[n].tolist() == [*there.min(axis=0), *there.max(axis=0)]
    assert found[3].tolist() == [99, 99, -1, -1]
    mask = kernels("panorama.warping.mark", labels, 1, 2, 3, out=[((9, 11), F32)])
    np.testing.assert_array_equal(mask, labels[2:11, 3:14] == 1)


@pytest.mark.parametrize("shape", [(1, 2, 2), (3, 12, 18)])
def test_bands(kernels, shape):
    fine = noise(*shape)
    small = (shape[0], shape[1] // 2, shape[2] // 2)
    coarse = kernels("panorama.blending.reduce", fine, out=[(small, F32)])
    np.testing.assert_allclose(coarse, reference.reduced(fine), rtol=0, atol=2e-6)
    weights = np.abs(noise(*shape[1:], seed=1))
    weights[0, 0] = 0
    room = np.zeros((shape[0], shape[1] + 3, shape[2] + 2), F32)
    planes = np.concatenate((fine, weights[None]))
    totals, sums = kernels(
        "panorama.blending.add_band", planes, np.concatenate((coarse, coarse[:1])), 0, 2, 1,
        out=[room, room[0] + F32(0.5)],
    )  # fmt: skip
    band = fine - reference.enlarged(coarse)
    inner = np.s_[2 : 2 + shape[1], 1 : 1 + shape[2]]
    np.testing.assert_allclose(totals[(slice(None), *inner)], weights * band, rtol=0, atol=2e-6)
    np.testing.assert_array_equal(sums[inner], weights + F32(0.5))
    assert totals.sum() == pytest.approx(totals[(slice(None), *inner)].sum(), abs=1e-4)
    back = kernels(
        "panorama.blending.collapse", weights, coarse, 0,
        out=[np.ascontiguousarray(totals[(slice(None), *inner)])],
    )  # fmt: skip
    there = weights > 0
    # What was taken away comes back, but for the rounding of two products and a quotient.
    np.testing.assert_allclose(back[:, there], fine[:, there], rtol=0, atol=4e-6)
    np.testing.assert_allclose(back[:, 0, 0], reference.enlarged(coarse)[:, 0, 0], atol=2e-6)
    last = kernels("panorama.blending.collapse", weights, coarse, 1, out=[fine])
    np.testing.assert_array_equal(last, np.where(there, fine / np.where(there, weights, 1), 0))


@pytest.mark.parametrize(("dtype", "high"), [(U8, 255.0), (F32, 1000.0), (F32, 0.0)])
def test_finish(kernels, dtype, high):
    values = noise(3, 9, 8) * 300
    labels = np.random.default_rng(2).integers(-1, 2, (9, 8)).astype(I32)
    image, mask = kernels(
        "panorama.blending.finish", values, labels, high, Part(1, 2, 3, 1, 6, 5),
        out=[np.full((10, 7, 3), 7, dtype), np.full((10, 7), 7, U8)],
    )  # fmt: skip
    part = np.moveaxis(values[:, 1:7, 2:7], 0, 2)
    there = labels[1:7, 2:7] >= 0
    whole = np.floor(part.clip(0, high) + F32(0.5)) if high else part
    np.testing.assert_array_equal(image[3:9, 1:6], np.where(there[..., None], whole, 0))
    np.testing.assert_array_equal(mask[3:9, 1:6], there)
    image[3:9, 1:6], mask[3:9, 1:6] = 7, 7
    assert (image == 7).all()
    assert (mask == 7).all()


RECTS = np.array([[-6, 2, 9, 16], [5, 0, 18, 12], [14, 3, 30, 16]], I32)  # round 24 columns
CANVAS = 18, 24


def images():
    """Return values and weights of three images on a canvas that is closed."""
    rng = np.random.default_rng(3)
    height, width = 14, 16
    values = rng.uniform(0, 1, (3, 2, height, width)).astype(F32)
    weights = np.zeros((3, height, width), F32)
    for n, (x0, y0, x1, y1) in enumerate(RECTS):
        h, w = y1 - y0, x1 - x0
        across, down = (1 - np.abs((np.arange(k) + 0.5) / k * 2 - 1) for k in (w, h))
        weights[n, :h, :w] = np.round(8 * np.outer(down, across)) / 8  # with ties
        weights[n, h // 2, : w // 3] = 0
    return values, weights


def test_seams(kernels):
    values, weights = images()
    gains = np.array([[1, 1.5], [0.5, 1], [1, 2]], F32)
    costs, most, second = kernels(
        "panorama.seams.compare", values, weights, RECTS, gains, 3.0,
        out=[(CANVAS, I32), (CANVAS, F32), (CANVAS, F32)],
    )  # fmt: skip
    there = np.zeros((3, *CANVAS), F32)
    colours = np.full((3, 2, *CANVAS), np.nan, F32)
    for n, rect in enumerate(RECTS):
        y, x = reference.on_canvas(rect, CANVAS)
        h, w = len(y), x.shape[1]
        there[n][y, x] = weights[n, :h, :w]
        seen = values[n, :, :h, :w] * gains[n][:, None, None]
        colours[n][:, y, x] = np.where(weights[n, :h, :w] > 0, seen, np.nan)
    ranked = np.sort(there, axis=0)
    np.testing.assert_array_equal(most, ranked[-1])
    np.testing.assert_array_equal(second, ranked[-2])
    both = ranked[-2] > 0
    low, high = np.nanmin(colours[..., both], 0), np.nanmax(colours[..., both], 0)
    apart = np.zeros(CANVAS, F32)
    apart[both] = (high - low).max(axis=0)
    d = F32(3) * apart
    np.testing.assert_array_equal(costs, 1 + (F32(64) / (F32(1) + d * d)).astype(I32))

    gaps = np.sort((most - second)[both])
    margin = gaps[len(gaps) // 2]  # one image exceeds the others by just so much
    starts = kernels(
        "panorama.seams.seed", weights, RECTS, most, second, float(margin),
        out=[(weights.shape, I32)],
    )  # fmt: skip
    want = np.full(weights.shape, OUTSIDE)
    for n, rect in enumerate(RECTS):
        y, x = reference.on_canvas(rect, CANVAS)
        own = weights[n, : len(y), : x.shape[1]]
        alone = second[y, x] == 0
        sure = (own == most[y, x]) & (own - second[y, x] >= margin)
        seeds = np.where(alone | sure, 0, FAR)
        want[n, : len(y), : x.shape[1]] = np.where(own > 0, seeds, OUTSIDE)
    np.testing.assert_array_equal(starts, want)
    assert {0, FAR} < set(want.ravel().tolist())

    found, changed = starts, 1
    while changed:
        found, (changed,) = kernels(
            "panorama.seams.grow", costs, RECTS, out=[found, np.zeros(1, I32)]
        )
    for n, rect in enumerate(RECTS):
        h, w = rect[3] - rect[1], rect[2] - rect[0]
        nearest = reference.distances(costs, rect, starts[n, :h, :w])
        np.testing.assert_array_equal(found[n, :h, :w], nearest)

    labels = kernels("panorama.seams.choose", found, weights, RECTS, out=[(CANVAS, I32)])
    away = np.full((3, *CANVAS), FAR + 1)
    for n, rect in enumerate(RECTS):
        y, x = reference.on_canvas(rect, CANVAS)
        own = found[n, : len(y), : x.shape[1]]
        away[n][y, x] = np.where(own >= 0, own, FAR + 1)
    nearest = np.where(away.min(axis=0) < FAR, away.argmin(axis=0), there.argmax(axis=0))
    np.testing.assert_array_equal(labels, np.where(most > 0, nearest, NOBODY))


def test_where_no_front_comes_the_largest_weight_wins(kernels):
    _, weights = images()
    nowhere = np.where(weights > 0, FAR, OUTSIDE).astype(I32)
    labels = kernels("panorama.seams.choose", nowhere, weights, RECTS, out=[(CANVAS, I32)])
    there = np.zeros((3, *CANVAS), F32)
    for n, rect in enumerate(RECTS):
        y, x = reference.on_canvas(rect, CANVAS)
        there[n][y, x] = weights[n, : len(y), : x.shape[1]]
    want = np.where(there.max(axis=0) > 0, there.argmax(axis=0), NOBODY)
    np.testing.assert_array_equal(labels, want)
