"""Responses, radiance, fusion and alignment: synthetic scenes of known truth, and a real one."""

import json
from typing import Any

import cv2
import imageio.v3 as iio
import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.raw import alignment
from tests.raw import reference_pyramids as reference
from tests.truth import truth

TIMES = np.array([1 / 128, 1 / 32, 1 / 8, 1 / 2, 2.0])
CODES = np.arange(256)


def gamma(x):
    return x ** (1 / 2.2)


def bent(x):
    y = x ** (1 / 2.2)
    return 0.5 * y + 0.5 * y * y * (3 - 2 * y)


def scene(curve, noise, shape=(120, 160), seed=0):
    """Return exposures, the radiance, and log2 of the exposure of each code."""
    rng = np.random.default_rng(seed)
    soft = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 12)
    radiance = np.exp(1.5 * soft / soft.std() + 0.3 * rng.normal(size=shape))
    exact = [255 * curve(np.clip(radiance * t, 0, 1)) for t in TIMES]
    images = [np.clip(np.rint(e + rng.normal(0, noise, shape)), 0, 255) for e in exact]
    fine = np.linspace(1e-6, 1, 100001)
    return np.array(images, np.uint8), radiance, np.log2(np.interp(CODES / 255, curve(fine), fine))


def stops(found, true, ends=slice(None)):
    off = (np.log2(np.maximum(found, 1e-9)) - np.log2(true))[ends]
    off = off - np.median(off)
    return np.sqrt(np.mean(off**2))


@pytest.mark.parametrize("curve", [gamma, bent])
@pytest.mark.parametrize("noise", [0, 1])
def test_response_and_radiance(backend, curve, noise):
    images, radiance, true = scene(curve, noise)
    response = cvkern.estimate_response(images, TIMES)
    assert response.shape == (256, 1)
    assert (np.diff(response, axis=0) >= 0).all()
    off = response[10:246, 0] - true[10:246]
    assert np.std(off) < 0.02
    # A step of the darkest exposures is more than the noise; most pixels have better ones.
    assert stops(cvkern.merge_exposures(images, TIMES, response), radiance) < 0.03
    order = np.random.default_rng(1).permutation(len(TIMES))
    again = cvkern.merge_exposures(images[order], TIMES[order])
    np.testing.assert_allclose(again, cvkern.merge_exposures(images, TIMES), rtol=1e-5)


def test_robertson_is_near_the_curve():
    images, _, true = scene(gamma, 1)
    response = cvkern.estimate_response(images, TIMES, "robertson")
    assert np.std(response[10:246, 0] - true[10:246]) < 0.13


def test_robertson_is_the_stated_iteration():
    images, _, _ = scene(gamma, 1, (30, 40))
    z, t = images.reshape(len(TIMES), -1), TIMES[:, None]
    # Codes near the ends, which may be clipped, have no weight, nor a place on the curve.
    near = (np.minimum(CODES, 255 - CODES) - 3).clip(0) / 124
    weight = np.where(near > 0, np.exp(-4 * (1 - near) ** 2), 0)
    z = z[:, weight[z].any(axis=0)]
    w, curve = weight[z], (CODES + 0.5) / 128
    for _ in range(40):
        light = np.sum(w * t * curve[z], axis=0) / np.sum(w * t**2, axis=0)
        held = [m for m in CODES if (z == m).any() and weight[m]]
        new = np.interp(CODES, held, [np.mean((t * light)[z == m]) for m in held])
        new, before = new / new[128], curve
        curve = new
        if np.abs(new - before).max() < 1e-4:
            break
    off = np.log2(curve) - np.log2(curve[128])
    upper = np.maximum.accumulate(off[128:].clip(0))
    lower = np.minimum.accumulate(off[128::-1].clip(None, 0))[::-1]
    rising = np.concatenate([lower[:-1], upper])
    got = cvkern.estimate_response(images, TIMES, "robertson")[:, 0]
    np.testing.assert_allclose(got, rising - rising[128], atol=1e-9)  # float64, 40 rounds


def test_wrong_values_hardly_bend_the_curve():
    """Values of what moved, or lost its colour; with equal weights they cost 0.16 stops."""
    images, _, true = scene(gamma, 1)
    wrong = images.copy()
    wrong[1, :9], wrong[2, :, :12] = 20, 6
    response = cvkern.estimate_response(wrong, TIMES)
    assert np.std(response[10:246, 0] - true[10:246]) < 0.06
    assert (np.diff(response[:, 0]) >= 0).all()


def test_merging_is_the_stated_mean(backend):
    rng = np.random.default_rng(2)
    images = rng.integers(0, 256, (3, 7, 9, 3)).astype(np.uint8)
    seconds = np.array([1.0, 0.125, 4.0])
    response = np.cumsum(rng.uniform(0.02, 0.06, (256, 3)), axis=0)
    near = (np.minimum(CODES, 255 - CODES) - 3).clip(0) / 124
    weight = (near * np.clip(8 * near, 0, 1) ** 2)[:, None] / np.gradient(response, axis=0) ** 2
    channel = np.arange(3)
    w = weight[images, channel]
    light = response[images, channel] - np.log2(seconds)[:, None, None, None]
    total = w.sum(axis=0)
    mean = (w * light).sum(axis=0) / np.where(total > 0, total, 1)
    got = cvkern.merge_exposures(images, seconds, response)
    np.testing.assert_allclose(got[total > 0], 2 ** mean[total > 0], rtol=1e-5)
    # Too bright for all: the shortest; too dark for all: the longest.
    ends = np.array([[[255, 0]], [[255, 0]], [[255, 0]]], np.uint8)
    got = cvkern.merge_exposures(ends, seconds, response[:, :1])
    want = 2 ** (response[[255, 0], 0] - np.log2([0.125, 4]))
    np.testing.assert_allclose(got[0], want, rtol=1e-5)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32, np.float64])
def test_linear_values(backend, dtype):
    light = np.random.default_rng(3).uniform(100, 8000, (20, 30))
    images = np.stack([np.minimum(light * t, 10000) for t in (0.25, 1, 4)]).astype(dtype)
    got = cvkern.merge_exposures(images, [0.25, 1, 4])
    # Whole numbers lose less than 1 each: sum(t) / sum(t^2) = 0.308 of the mean, beside 100.
    np.testing.assert_allclose(got, light, rtol=3.1e-3 if dtype == np.uint16 else 1e-6)
    grey = images[:2].clip(0, 255).astype(np.uint8)
    got = cvkern.merge_exposures(grey, [1, 1], "linear")
    assert got.dtype == np.float32


def test_what_moved_does_not_count(backend):
    images = np.stack([np.full((9, 9), 0.2 * t) for t in (0.5, 1, 2)])
    images[2, 3, 3], images[2, 0, 0] = 0.6, 1.0  # the brightest counts as saturated
    plain = cvkern.merge_exposures(images, [0.5, 1, 2])
    clean = cvkern.merge_exposures(images, [0.5, 1, 2], deghost=0.5)
    np.testing.assert_allclose(clean, 0.2, rtol=1e-6)
    assert plain[3, 3] > 0.25


@pytest.mark.parametrize("value", [3.0, 1717986918.0, 0.7])
def test_what_is_just_so_many_stops_away_counts(backend, value):
    """The reference has just twice the light, which no rounding of a logarithm may decide."""
    images = np.full((3, 4, 5), value, np.float32)
    images[1] = images[2] = value / 4
    images[0, 0, 0] = 8 * value  # white
    both = cvkern.merge_exposures(images, [1, 0.5, 0.25], deghost=1)
    plain = cvkern.merge_exposures(images, [1, 0.5, 0.25])
    np.testing.assert_array_equal(both[1:], plain[1:])
    less = cvkern.merge_exposures(images, [1, 0.5, 0.25], deghost=0.99)
    assert (less[1:] < plain[1:]).all()


def test_the_middle_exposure_tells_what_moved(backend):
    """Light that only the middle one of five shows stays; light that only another shows goes."""
    times = [4, 0.25, 1, 0.5, 2]
    images = np.stack([np.full((5, 6), 0.05 * t) for t in times])
    images[2, 1, 1], images[1, 3, 3], images[4, 3, 4] = 0.1, 0.05, 0.02
    got = cvkern.merge_exposures(images, times, deghost=0.3)
    want = np.full((5, 6), 0.05)
    want[1, 1] = 0.1
    np.testing.assert_allclose(got, want, rtol=1e-6)


def test_memorial_church():
    """Against the radiance map of Debevec and Malik: OpenCV's is off by 0.085 stops."""
    folder = truth("light_colour") / "hdr" / "memorial"
    times = json.loads((folder / "exposure_seconds.json").read_text())
    images = np.stack([iio.imread(folder / name)[..., :3] for name in times])
    marked = (images[..., 2] > 200) & (images[..., :2] < 30).all(axis=-1)
    stored: Any = cv2.imread(str(folder / "debevec.hdr"), cv2.IMREAD_UNCHANGED)
    radiance = stored[..., ::-1]
    found = cvkern.merge_exposures(images, list(times.values()))
    off = (np.log2(np.maximum(found, 1e-12)) - np.log2(np.maximum(radiance, 1e-12)))[~marked.any(0)]
    off -= np.median(off, axis=0)
    assert np.median(np.abs(off)) < 0.072

    def agreement(fused):
        ranks = [np.argsort(np.argsort(v.mean(-1)[~marked.any(0)])) for v in (fused, radiance)]
        return np.corrcoef(ranks[0], ranks[1])[0, 1]

    assert agreement(cvkern.fuse_exposures(images)) > 0.981  # OpenCV: 0.979
    plain = cvkern.fuse_exposures(images, contrast=0, saturation=0, exposure=0.5)
    assert agreement(plain) > 0.99


@pytest.mark.parametrize("shape", [(48, 64), (51, 37, 3)])
def test_fusion_stays_inside(backend, shape):
    rng = np.random.default_rng(4)
    images = rng.integers(0, 256, (3, *shape)).astype(np.uint8)
    fused = cvkern.fuse_exposures(images)
    assert fused.shape == shape
    assert fused.min() >= 0
    assert fused.max() <= 1
    same = np.full((2, *shape), 0.4)
    np.testing.assert_allclose(cvkern.fuse_exposures(same), 0.4, atol=1e-5)


@pytest.mark.parametrize("shape", [(3, 20, 30, 3), (2, 9, 14)])
def test_other_whites_are_fused_as_8_bits(backend, shape):
    images = np.random.default_rng(6).integers(0, 256, shape).astype(np.uint8)
    # Both round each value once, by 6e-8, before the sums of the method.
    want = cvkern.fuse_exposures(images)
    wide, floats = images.astype(np.uint16), images.astype(np.float32)
    for given, white in ((wide * 257, None), (wide, 255), (wide, None), (floats, None)):
        got = cvkern.fuse_exposures(given, white=white)
        np.testing.assert_allclose(got, want, atol=1e-6)


def test_missing_values_are_missing_radiance():
    assert np.isnan(cvkern.merge_exposures(np.full((2, 3, 4), np.nan), [1, 2])).all()


@pytest.mark.parametrize("powers", [(1, 1, 1), (0.7, 0, 2)])
@pytest.mark.parametrize("shape", [(3, 37, 150, 3), (2, 9, 14, 1), (2, 6, 270, 1), (2, 1, 5, 1)])
def test_fusion_is_the_stated_method(backend, shape, powers):
    """In float32, whose rounding is 6e-8 of 1, over some ten sums and the weights' quotients.

    Where the edges of all images cancel, a rounding of 1e-7 to the power of 0.7 is 1e-5 of what is
    left of the weights: there single pixels are off by more.
    """
    images = np.random.default_rng(5).integers(0, 256, shape).astype(np.uint8)
    want = reference.fused(images / 255, *powers)
    names = dict(zip(("contrast", "saturation", "exposure"), powers, strict=True))
    for given in (images, (images / 255).astype(np.float32)):
        off = np.abs(cvkern.fuse_exposures(given, **names) - want)
        assert off.mean() < 5e-7
        assert off.max() < (5e-6 if powers[0] == 1 else 1e-3)


def test_fused_bits_are_equal():
    images = np.random.default_rng(6).integers(0, 256, (3, 45, 70, 3)).astype(np.uint8)
    answers = []
    for name in ("warp", "taichi"):
        with cvkern.use(name):
            answers.append(cvkern.fuse_exposures(images))
    np.testing.assert_array_equal(*answers)


def test_fusion_is_that_of_opencv_but_for_its_range():
    """Where OpenCV stays within 0.05 to 0.95, away from the border that it mirrors otherwise."""
    images, *_ = scene(gamma, 0, (128, 128))
    colours = [cv2.merge([image] * 3) for image in images[1:4]]
    want = cv2.createMergeMertens(1.0, 0.0, 1.0).process(colours)
    got = cvkern.fuse_exposures(np.stack(colours), saturation=0)
    inside = (want > 0.06).all(-1) & (want < 0.94).all(-1)
    assert np.abs(got - want)[inside].mean() < 0.02


def test_fusion_keeps_the_order_of_light():
    images, radiance, _ = scene(gamma, 1, (200, 300))
    ranks = [np.argsort(np.argsort(v.ravel())) for v in (cvkern.fuse_exposures(images), radiance)]
    assert np.corrcoef(ranks[0], ranks[1])[0, 1] > 0.985


@pytest.mark.parametrize("seed", [1, 5])
def test_noise_about_the_median_does_not_count(seed):
    """Two thirds of the picture are the median and noise; a third tells how it moved."""
    rng = np.random.default_rng(seed)
    soft = cv2.GaussianBlur(rng.normal(size=(64, 96)), (0, 0), 4)
    soft = 120 + 60 * soft / np.abs(soft).max()
    soft[:, 32:] = 120
    noise = rng.integers(-1, 2, (2, 64, 96))
    images = (np.stack([soft, np.roll(soft, (3, -2), (0, 1))]) + noise).astype(np.uint8)
    assert cvkern.align_exposures(images, reach=8).shifts.tolist() == [[3, -2], [0, 0]]


def test_sides_are_those_of_the_lower_median(backend):
    """Of an even number of pixels it is the lower of the two in the middle."""
    levels = np.array([[[0, 9, 9, 9], [0, 0, 9, 0]], [[3, 3, 4, 4], [4, 4, 4, 1]]], np.int32)
    rt = runtime(levels)
    _, medians = alignment._split(rt, 0, rt.adopt(levels, levels.dtype))
    assert rt.to_numpy(medians).tolist() == [0, 4]


def test_alignment(backend):
    images, *_ = scene(gamma, 1, (160, 200))
    moves = [(5, -3), (-7, 11), (0, 0), (2, 6), (-9, -4)]
    moved = np.stack([np.roll(i, m, (0, 1)) for i, m in zip(images, moves, strict=True)])
    found = cvkern.align_exposures(moved, reach=16)
    relative = found.shifts + np.array(moves)
    np.testing.assert_array_equal(relative, np.broadcast_to(relative[0], relative.shape))
    inner = np.s_[:, 20:-20, 20:-20]
    first = np.roll(images, tuple(relative[0]), (1, 2))
    np.testing.assert_array_equal(found.images[inner], first[inner])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_both_sets_move_alike(dtype):
    """In colour, with odd sides, partly out of reach of each other, against NumPy's moves."""
    rng = np.random.default_rng(7)
    soft = cv2.GaussianBlur(rng.random((71, 93, 3)), (0, 0), 3)
    images = np.stack([np.roll(soft * t, m, (0, 1)) for t, m in ((1, (4, -7)), (2, (0, 0)))])
    images = (images * (1 if dtype == np.float64 else 100)).astype(dtype)
    answers = []
    for name in ("warp", "taichi"):
        with cvkern.use(name):
            answers.append(cvkern.align_exposures(images, reach=8))
    np.testing.assert_array_equal(answers[0].shifts, answers[1].shifts)
    assert np.abs(answers[0].shifts).sum() == 11
    rows, columns = (np.arange(n) for n in images.shape[1:3])
    for k, (dy, dx) in enumerate(answers[0].shifts):
        want = images[k][(rows - dy).clip(0, 70)][:, (columns - dx).clip(0, 92)]
        for answer in answers:
            assert answer.images.dtype == dtype
            np.testing.assert_array_equal(answer.images[k], want)


IMAGES = np.zeros((2, 4, 4), np.uint8)


@pytest.mark.parametrize(
    ("error", "message", "call"),
    [
        (TypeError, "images must be uint8, got float64",
         lambda: cvkern.estimate_response(IMAGES.astype(float), [1, 2])),
        (ValueError, "images must be at least 2, got 1",
         lambda: cvkern.merge_exposures(IMAGES[:1], [1])),
        (ValueError, "seconds must be 2, one an image, got shape (3,)",
         lambda: cvkern.merge_exposures(IMAGES, [1, 2, 3])),
        (ValueError, "seconds must be above 0, got [1.0, 0.0]",
         lambda: cvkern.merge_exposures(IMAGES, [1, 0])),
        (ValueError, "seconds must not all be equal, got 1",
         lambda: cvkern.estimate_response(IMAGES, [1, 1])),
        (ValueError, "seconds must be in the order of the images: longer exposures are darker "
         "with 2, 1", lambda: cvkern.merge_exposures(np.stack([IMAGES[0], IMAGES[1] + 9]), [2, 1])),
        (TypeError, "images must be uint8, uint16 or floating, got int64",
         lambda: cvkern.fuse_exposures(IMAGES.astype(np.int64))),
        (ValueError, "response must have shape (256, 1), got (256, 3)",
         lambda: cvkern.merge_exposures(IMAGES, [1, 2], np.zeros((256, 3)))),
        (ValueError, "response must be of uint8 images, got float64",
         lambda: cvkern.merge_exposures(IMAGES * 1.0, [1, 2], np.zeros((256, 1)))),
        (ValueError, "images must have 1 or 3 channels, got 2",
         lambda: cvkern.fuse_exposures(np.zeros((2, 4, 4, 2)))),
        (ValueError, "contrast must be >= 0 and finite, got -1",
         lambda: cvkern.fuse_exposures(IMAGES, contrast=-1)),
        (ValueError, "white must be >= 1e-30 and finite, got 0",
         lambda: cvkern.fuse_exposures(IMAGES, white=0)),
        (ValueError, "reach must be in [1, 1024], got 0",
         lambda: cvkern.align_exposures(IMAGES, reach=0)),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, error, message, call):
    with pytest.raises(error) as info:
        call()
    assert str(info.value) == message
