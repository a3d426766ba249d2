"""stereo_match and StereoMatcher, on pairs made from known disparities."""

import numpy as np
import pytest
import scipy.ndimage as ndi

import cvkern
from cvkern.images import read_image
from tests.stereo import reference_costs as cost_reference
from tests.stereo import reference_paths as paths_reference
from tests.stereo import reference_refinement as refinement
from tests.truth import truth

METHODS = ["semi-global", "window"]


def texture(height, width, seed=0, blur=1.0):
    """Grey values in [0, 255], as smooth as a lens leaves them."""
    rng = np.random.default_rng(seed)
    values = ndi.gaussian_filter(rng.normal(size=(height, width)), blur)
    return (values / values.std() * 45 + 128).clip(0, 255)


def pair_of(disparity, seed=0, noise=0.0):
    """Return uint8 images whose left pixel (y, x) is the right one's (y, x - disparity)."""
    height, width = disparity.shape
    margin = 100
    wide = texture(height, width + 2 * margin, seed)
    y, x = np.mgrid[:height, :width].astype(float)
    left = ndi.map_coordinates(wide, [y, x - disparity + margin], order=5, mode="nearest")
    rng = np.random.default_rng(seed + 1)
    pair = left, wide[:, margin : margin + width]
    return [
        (image + rng.normal(0, noise, image.shape)).clip(0, 255).round().astype(np.uint8)
        for image in pair
    ]


def dots(height, width, shift, seed=0):
    """A random-dot pair, the left image `shift` pixels to the right of the other."""
    wide = np.random.default_rng(seed).integers(0, 256, (height, width + abs(shift)), np.uint8)
    begin = max(0, shift)
    return wide[:, begin - shift : begin - shift + width], wide[:, begin : begin + width]


def match(pair, *arguments, **options):
    left, right = pair
    return cvkern.stereo_match(left, right, *arguments, **options)


def inside(disparity):
    """Tell which pixels match one of the right image."""
    x = np.arange(disparity.shape[1])
    return (x - disparity > 1) & (x - disparity < disparity.shape[1] - 2)


def assert_same(first, second):
    for a, b in zip(first, second, strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


# --- what is matched -----------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("shift", "disparities"), [
    (0, (0, 1)), (7, (0, 16)), (7, (5, 12)), (-9, (-20, 3)), (12, (10, 45)), (31, (0, 33)),
])  # fmt: skip
def test_random_dots(backend, method, shift, disparities):
    left, right = dots(30, 80, shift)
    result = cvkern.stereo_match(left, right, disparities, method=method)
    assert [a.dtype for a in result] == [np.float32, np.bool_, np.float32]
    assert all(a.shape == left.shape for a in result)
    seen = inside(np.full(left.shape, shift))
    # Dots are not smooth: the fit between pixels leans to where they happen to be alike.
    assert np.abs(result.disparity - shift)[seen].max() < 0.5
    assert result.valid[seen].mean() > 0.9
    assert result.confidence.min() >= 0
    assert result.confidence.max() <= 1


PLANES = {
    "facing": lambda y, x: 10.37 + 0 * x,
    "along": lambda y, x: 8 + 0.05 * x,
    "down": lambda y, x: 10 + 0.07 * y,
    "both": lambda y, x: 12 + 0.05 * x - 0.04 * y,
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["along", "down", "both"])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_slanted_planes(backend, method, name, noise):
    y, x = np.mgrid[:100, :160].astype(float)
    disparity = PLANES[name](y, x)
    left, right = pair_of(disparity, noise=noise)
    result = cvkern.stereo_match(left, right, (0, 32), method=method)
    error = np.abs(result.disparity - disparity)[inside(disparity)]
    assert np.median(error) < 0.1
    assert (error > 1).mean() < 0.01


def test_two_lines_fit_better_than_a_parabola():
    y, x = np.mgrid[:100, :160].astype(float)
    disparity = PLANES["both"](y, x)
    pair = pair_of(disparity)
    errors = {
        fit: np.abs(match(pair, (0, 32), subpixel=fit).disparity - disparity)
        for fit in ("equiangular", "parabola", False)
    }
    medians = {fit: np.median(error[inside(disparity)]) for fit, error in errors.items()}
    assert medians["equiangular"] < medians["parabola"] < medians[False]


@pytest.mark.parametrize("method", METHODS)
def test_an_occluder(backend, method):
    """A square before a wall: what it hides is not valid, and is filled with the wall."""
    near, far = 22, 6
    disparity = np.full((90, 150), float(far))
    square = np.s_[25:65, 60:110]
    disparity[square] = near
    wall, object_ = texture(90, 400, 1), texture(90, 400, 2)
    columns = np.arange(150) + 100
    left, right = (wall[:, columns - far].copy(), wall[:, columns].copy())
    left[square] = object_[square[0], columns[square[1]] - near]
    right[25:65, 60 - near : 110 - near] = object_[25:65, columns[60 - near : 110 - near]]
    pair = [image.round().astype(np.uint8) for image in (left, right)]
    result = match(pair, (0, 32), method=method)
    hidden = np.zeros(disparity.shape, bool)
    hidden[30:60, 60 - (near - far) + 3 : 57] = True  # but where windows see both
    assert result.valid[hidden].mean() < 0.1
    assert (np.abs(result.disparity - far) < 1)[hidden].mean() > 0.95
    error = np.abs(result.disparity - disparity)[inside(disparity)]
    assert (error > 1).mean() < 0.05
    np.testing.assert_allclose(result.disparity[35:55, 70:100], near, atol=0.5)


@pytest.mark.parametrize("method", METHODS)
def test_brightness_of_both_makes_no_difference(backend, method):
    y, x = np.mgrid[:40, :90].astype(float)
    pair = [image // 2 + 40 for image in pair_of(PLANES["both"](y, x))]
    want = match(pair, (0, 24), method=method)
    for offset in (-40, 60):
        moved = [(image.astype(int) + offset).astype(np.uint8) for image in pair]
        assert_same(match(moved, (0, 24), method=method), want)


def test_brightness_of_one_makes_little_difference(backend):
    y, x = np.mgrid[:60, :120].astype(float)
    disparity = PLANES["both"](y, x)
    left, right = pair_of(disparity)
    darker = (right * 0.7).astype(np.uint8)
    result = cvkern.stereo_match(left, darker, (0, 32))
    assert (np.abs(result.disparity - disparity) > 1)[inside(disparity)].mean() < 0.02


# --- what it is made of --------------------------------------------------------------------------


def costs_of(left, right, first, stop):
    """The cost that the documentation states, in NumPy."""
    radii = (2, 2)
    census = cost_reference.stereo_cost(
        left[..., None], right[..., None], (first, stop), "census", (0, 0), radii
    )
    columns = np.arange(left.shape[1])
    costs = np.empty(census.shape, np.uint8)
    for k in range(stop - first):
        other = right[:, (columns - first - k).clip(0, left.shape[1] - 1)]
        unlike = np.abs(left.astype(int) - other)
        costs[..., k] = 2 * census[..., k] + np.minimum(unlike >> 1, 6)
    return costs


@pytest.mark.parametrize(("shape", "disparities"), [
    ((1, 1), (0, 1)), ((1, 9), (-3, 5)), ((9, 1), (0, 1)), ((20, 33), (-7, 12)), ((7, 20), (2, 19)),
])  # fmt: skip
@pytest.mark.parametrize(("paths", "p1", "p2"), [(8, 20, 80), (4, 5, 300), (16, 0, 0)])
def test_the_steps(backend, shape, disparities, paths, p1, p2):
    rng = np.random.default_rng(3)
    left, right = rng.integers(0, 256, (2, *shape), np.uint8)
    got = cvkern.stereo_match(
        left, right, disparities, paths=paths, p1=p1, p2=p2, contrast=7.5, subpixel="parabola",
        uniqueness=3, left_right=1.5, speckle_size=4, speckle_difference=0.75, smoothing=2,
    )  # fmt: skip

    costs = costs_of(left, right, *disparities)
    table = [max(p1, int(p2 * 7.5 // (7.5 + g))) for g in range(256)]
    sums = paths_reference.aggregate(costs, left, p1, table, paths).astype(np.uint16)
    winner = cvkern.winner_take_all(sums, first=disparities[0], uniqueness=3)
    index = paths_reference.pick_right(sums, disparities[0])
    other = np.where(index < 0, np.nan, disparities[0] + index)
    found = refinement.left_right(winner.disparity, other, 1.5)
    found = refinement.remove_speckles(found, 4, 0.75)
    filled, valid = refinement.fill(found)
    want = refinement.guided_median(filled, left, 2, 40)
    assert_same(got, (want, valid, winner.confidence))


@pytest.mark.parametrize(("window", "subpixel", "uniqueness", "tolerance"), [
    (5, "parabola", 0, 1.5), (3, "equiangular", 12, 0.5), (7, "none", 3, None),
])  # fmt: skip
def test_the_steps_by_windows(backend, window, subpixel, uniqueness, tolerance):
    left, right = pair_of(np.full((17, 40), 4.5), seed=5, noise=12.0)
    disparities = (-2, 9)
    got = cvkern.stereo_match(
        left, right, disparities, method="window", window=window, uniqueness=uniqueness,
        subpixel=False if subpixel == "none" else subpixel, left_right=tolerance, speckle_size=4,
        speckle_difference=0.75, smoothing=2,
    )  # fmt: skip

    costs = cost_reference.stereo_cost(
        left[..., None], right[..., None], disparities, "census", (window // 2,) * 2, (2, 2), 2
    )
    _, found, _, confidence = paths_reference.pick(costs, disparities[0], subpixel, uniqueness)
    assert np.isnan(found).any() == (uniqueness > 0)
    if tolerance is not None:
        index = paths_reference.pick_right(costs, disparities[0])
        other = np.where(index < 0, np.nan, disparities[0] + index)
        found = refinement.left_right(found, other, tolerance)
    filled, valid = refinement.fill(refinement.remove_speckles(found, 4, 0.75))
    assert 0 < valid.sum() < valid.size
    want = refinement.guided_median(filled, left, 2, 40)
    np.testing.assert_array_equal(got.valid, valid)
    # The fit rounds three times in float32, the oracle once.
    np.testing.assert_allclose(got.disparity, want, rtol=3e-7)
    np.testing.assert_allclose(got.confidence, confidence, rtol=0, atol=2e-7)


def test_steps_left_out(backend):
    left, right = pair_of(np.full((30, 70), 5.5), noise=8.0)
    plain = {"left_right": None, "speckle_size": 0, "smoothing": 0}
    result = cvkern.stereo_match(left, right, (0, 12), subpixel=False, **plain)
    assert result.valid.all()
    sums = paths_reference.aggregate(
        costs_of(left, right, 0, 12), left, 20, [max(20, 1600 // (20 + g)) for g in range(256)], 8
    )
    np.testing.assert_array_equal(result.disparity, sums.argmin(2))
    checked = cvkern.stereo_match(left, right, (0, 12), **{**plain, "left_right": 0.5})
    assert not checked.valid.all()
    np.testing.assert_array_equal(  # only what is not valid is filled
        checked.disparity[checked.valid],
        cvkern.stereo_match(left, right, (0, 12), **plain).disparity[checked.valid],
    )


@pytest.mark.parametrize("method", METHODS)
def test_colours_and_dtypes(backend, method):
    rng = np.random.default_rng(4)
    left = rng.integers(0, 256, (20, 40, 3), np.uint8)
    pair = left, np.roll(left, -5, axis=1)
    call = {"disparities": (0, 16), "method": method}
    grays = [
        ((p.astype(int) * np.array([77, 150, 29])).sum(2) + 128 >> 8).astype(np.uint8) for p in pair
    ]
    want = match(grays, **call)
    assert want.valid.any()
    for axis in (0, 1, 2, -1):
        moved = [np.moveaxis(p, -1, axis) for p in pair]
        assert_same(match(moved, channel_axis=axis, **call), want)
    alpha = [np.dstack([p, rng.integers(0, 256, p.shape[:2], np.uint8)]) for p in pair]
    assert_same(match(alpha, channel_axis=2, **call), want)
    assert_same(match(alpha, **call), want)  # the last axis, if it has 3 or 4 channels
    for images, range_ in (
        ([g.astype(np.uint16) * 257 for g in grays], None),
        ([g.astype(np.uint16) * 4 for g in grays], 1020),
        ([g.astype(np.float64) / 255 for g in grays], None),
        ([g.astype(np.float32) for g in grays], 255),
        ([g.astype(np.int32) for g in grays], 255.0),
    ):
        assert_same(match(images, data_range=range_, **call), want)


@pytest.mark.parametrize("method", METHODS)
def test_stacks(backend, method):
    rng = np.random.default_rng(6)
    left = rng.integers(0, 256, (3, 21, 37, 3), np.uint8)
    right = np.stack([np.roll(one, -n - 3, axis=1) for n, one in enumerate(left)])
    call = {"disparities": (0, 9), "method": method}
    for pair in ((left[..., 1], right[..., 1]), (left, right)):
        want = [match((one, other), **call) for one, other in zip(*pair, strict=True)]
        got = match(pair, batch_axis=0, **call)
        assert_same(got, cvkern.StereoResult(*map(np.stack, zip(*want, strict=True))))
    moved = [np.moveaxis(p, -1, 1) for p in (left, right)]
    assert_same(match(moved, batch_axis=0, channel_axis=1, **call), got)
    with pytest.raises(ValueError, match="batch_axis must be None: a matcher takes one pair"):
        cvkern.StereoMatcher((21, 37), batch_axis=0)


def test_strips(backend):
    disparity = np.repeat(6 + 0.02 * np.arange(260.0)[:, None], 40, axis=1)
    left, right = pair_of(disparity)
    whole = cvkern.stereo_match(left, right, (0, 16))
    assert_same(cvkern.stereo_match(left, right, (0, 16), max_bytes=10**9), whole)
    message = r"^max_bytes must be at least \d+ for 260 x 40 pixels and 16 disparities, got 1000$"
    with pytest.raises(ValueError, match=message) as info:
        cvkern.stereo_match(left, right, (0, 16), max_bytes=1000)
    least = int(str(info.value).split()[5])
    strips = cvkern.stereo_match(left, right, (0, 16), max_bytes=least)
    # A path that begins 64 rows away has forgotten all but the beginning's excess.
    assert (np.abs(strips.disparity - whole.disparity) > 0.25).mean() < 0.01


# --- video ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"method": "window", "window": 5}, {"channel_axis": -1}])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_a_matcher_matches_as_the_function_does(backend, options, dtype):
    channels = (3,) if "channel_axis" in options else ()
    shape = 24, 50, *channels
    with cvkern.StereoMatcher(shape, (-2, 12), **options) as matcher:
        before = None
        for seed in range(3):
            rng = np.random.default_rng(seed)
            pair = (rng.random((2, *shape)) * (1 if dtype == "float32" else 255)).astype(dtype)
            result = matcher(*pair)
            assert_same(result, match(pair, (-2, 12), **options))
            assert before is None or all(a is b for a, b in zip(result, before, strict=True))
            before = result


def test_matchers_keep_apart(backend):
    pairs = [dots(20, 40, shift) for shift in (2, 5)]
    matchers = [cvkern.StereoMatcher((20, 40), (0, 8)) for _ in pairs]
    results = [matcher(*pair) for matcher, pair in zip(matchers, pairs, strict=True)]
    for result, pair in zip(results, pairs, strict=True):
        assert_same(result, match(pair, (0, 8)))


def test_a_matcher_serves_torch_and_jax(backend):
    torch, jax = pytest.importorskip("torch"), pytest.importorskip("jax.numpy")
    pairs = [dots(20, 40, shift) for shift in (2, 5)]
    for make in (lambda a: torch.from_numpy(a.copy()), jax.asarray):
        with cvkern.StereoMatcher((20, 40), (0, 8)) as matcher:
            results = []
            for pair in pairs:
                result = matcher(*map(make, pair))
                assert all(type(a) is type(make(pair[0])) for a in result)
                want = match(pair, (0, 8))
                assert_same([np.asarray(a) for a in result], want)
                results.append([np.asarray(a).copy() for a in result])
            assert not np.array_equal(results[0][0], results[1][0])


def test_a_matcher_refuses(backend):
    left, right = dots(20, 40, 3)
    matcher = cvkern.StereoMatcher((20, 40), (0, 8))
    for images in ((left[1:], right), (left, right[:, 1:])):
        with pytest.raises(ValueError, match=r"^(left|right) must have shape \(20, 40\), got "):
            matcher(*images)
    matcher(left, right)
    with pytest.raises(TypeError, match=r"^right must be uint8 .* got ndarray of float64$"):
        matcher(left, right.astype(float))
    matcher.close()
    with pytest.raises(ValueError, match=r"^matcher must be open, got one that has been closed$"):
        matcher(left, right)
    with pytest.raises(TypeError, match="unexpected keyword argument 'sigma'"):
        cvkern.StereoMatcher((20, 40), (0, 8), sigma=2)
    with pytest.raises(ValueError, match=r"^p1 must be <= p2, got 30 > 20$"):
        cvkern.StereoMatcher((20, 40), (0, 8), p1=30, p2=20)
    with pytest.raises(ValueError, match=r"^shape must be in \[1, 536870912\], got 0$"):
        cvkern.StereoMatcher((0, 40))


# --- photographs with ground truth ---------------------------------------------------------------

# Per cent of all pixels whose error is above 1 px, at most: what OpenCV's StereoSGBM in mode HH
# reaches, filled; and the best of windows of 7, 11 and 21 by squared differences of colours.
SGBM = {"tsukuba": 5.2, "venus": 3.7, "teddy": 17.0, "cones": 12.7, "motorcycle": 12.1,
        "aloe": 17.5}  # fmt: skip
WINDOWS = {"tsukuba": 11.7, "venus": 12.5, "teddy": 28.5, "cones": 23.6, "motorcycle": 29.7,
           "aloe": 24.9}  # fmt: skip


def bad_pixels(name, **options):
    folder = truth("stereo") / name
    left, right = (read_image(folder / f"{side}.png") for side in ("left", "right"))
    with np.load(folder / "disparity.npz") as file:
        want = file["disparity"]
    stop = {"tsukuba": 16, "venus": 20, "teddy": 60, "cones": 60, "motorcycle": 64, "aloe": 224}
    axis = -1 if left.ndim == 3 else None
    result = cvkern.stereo_match(left, right, (0, stop[name]), channel_axis=axis, **options)
    known = np.isfinite(want)
    return 100 * (np.abs(result.disparity - want) > 1)[known].mean()


def test_photographs_semi_globally():
    bad = {name: bad_pixels(name) for name in SGBM}
    assert all(bad[name] <= SGBM[name] for name in SGBM), bad
    assert np.mean(list(bad.values())) <= 0.85 * np.mean(list(SGBM.values())), bad


def test_photographs_by_windows():
    bad = {name: bad_pixels(name, method="window") for name in WINDOWS}
    assert all(bad[name] <= WINDOWS[name] for name in WINDOWS), bad
