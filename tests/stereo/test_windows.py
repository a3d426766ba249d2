"""Matching by windows: equal to the winner among stored costs, without storing them."""

import json
from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.images import luma, read_image
from cvkern.kernels.codes.stereo import Cost, Rule, Subpixel, Winners
from cvkern.stereo.windows import BITS, OCTETS, match_windows, max_window
from tests.stereo.test_costs import pair
from tests.truth import truth

I32, F32 = np.int32, np.float32
OUTPUTS = (I32, F32, F32, F32, I32)  # index, disparity, cost, confidence, right index


def filled(shape: tuple[int, ...]) -> Any:
    return [np.full(shape, 77, dtype) for dtype in OUTPUTS]


def matched(left, right, disparities, window, subpixel=Subpixel.PARABOLA, uniqueness=0):
    """Match grey images; return arrays of OUTPUTS."""
    rt = runtime(left)
    one, other = rt.adopt(left, left.dtype), rt.adopt(right, right.dtype)
    results = filled(left.shape)
    *winners, right_index = (rt.adopt(a, a.dtype) for a in results)
    first, stop = disparities
    rule = Rule(first, subpixel, uniqueness)
    match_windows(rt, one, other, stop - first, window, rule, Winners(*winners), right_index)
    return results


def winners(costs, first, subpixel, uniqueness):
    """Return the winners of the primitives `pick` and `pick_right` among stored costs."""
    rt = runtime(costs)
    results = filled(costs.shape[:2])
    views = [rt.adopt(a, a.dtype) for a in results]
    volume = rt.adopt(costs, costs.dtype)
    rt.stereo.winners.pick(volume, Rule(first, subpixel, uniqueness), Winners(*views[:4]))
    rt.stereo.winners.pick_right(volume, first, views[4])
    return results


def assert_same(got, want):
    for a, b in zip(got, want, strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)  # NaN where there is NaN


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("window", [1, 5, 21])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (40, 1), (33, 90)])
def test_winners_are_those_of_stored_costs(backend, shape, window, dtype):
    left, right = pair(*shape, dtype=dtype, shift=4)
    ends = [(0, 1), (-3, 2), (0, 64), (-7, 66)]
    for first, stop in ends:
        disparities = max(first, 1 - shape[1]), min(stop, shape[1])
        costs = cvkern.stereo_cost(
            left, right, disparities, cost="census", window=window, neighborhood=5, spacing=2
        )
        for options in ((Subpixel.NONE, 0), (Subpixel.PARABOLA, 15), (Subpixel.EQUIANGULAR, 60)):
            got = matched(left, right, disparities, window, *options)
            assert_same(got, winners(costs, disparities[0], *options))


@pytest.mark.parametrize("window", [(1, 1), (3, 9), (15, 15)])
@pytest.mark.parametrize("cost", [Cost.SAD, Cost.BIRCHFIELD_TOMASI])
@pytest.mark.parametrize("channels", [1, 2])
def test_other_costs(backend, channels, cost, window):
    """Of bytes of which no sum reaches 65535."""
    left, right = (image // 8 for image in pair(19, 70, channels, shift=3))
    rt = runtime(left)
    results = filled(left.shape[:2])
    one, other = rt.adopt(left, np.uint8), rt.adopt(right, np.uint8)
    radius_y, radius_x = window[0] // 2, window[1] // 2
    *found, right_index = (rt.adopt(a, a.dtype) for a in results)
    rule = Rule(-2, Subpixel.EQUIANGULAR, 10)
    rt.stereo.windows.match_windows(
        one, other, 30, cost, 1, radius_y, radius_x, rule, Winners(*found), right_index
    )
    name = cost.name.lower()
    costs = cvkern.stereo_cost(
        left, right, (-2, 28), cost=name, window=window, channel_axis=-1
    ).astype(np.uint16)
    assert_same(results, winners(costs, -2, Subpixel.EQUIANGULAR, 10))


def test_the_largest_window(backend):
    """Sums stay below what marks the places that are no disparity."""
    rng = np.random.default_rng(2)
    left = rng.integers(0, 2, (60, 70)).astype(np.uint8) * 255
    right = 255 - left
    largest = max_window(runtime(left))
    assert largest == 51
    got = matched(left, right, (0, 3), largest)
    costs = cvkern.stereo_cost(left, right, (0, 3), window=largest, neighborhood=5, spacing=2)
    assert costs.dtype == np.uint16
    assert costs.max() > 2**14
    assert BITS == 8 * OCTETS
    assert BITS * largest**2 < 2**16 - 1 <= BITS * (largest + 2) ** 2
    assert_same(got, winners(costs, 0, Subpixel.PARABOLA, 0))


def test_slabs_do_not_show(monkeypatch):
    left, right = pair(90, 120)
    want = matched(left, right, (0, 50), 11)
    monkeypatch.setenv("CVKERN_NUM_THREADS", "5")
    assert_same(matched(left, right, (0, 50), 11), want)


def test_a_plane_is_found(backend):
    """A texture that is seen on a slanted plane: x - d(x) = 0.95 x - 10 in the right image."""
    rng = np.random.default_rng(3)
    waves = [(rng.uniform(0.15, 0.9), rng.uniform(0, 6, (60, 1))) for _ in range(12)]
    x = np.arange(200)
    left, right = (
        np.sum([np.cos(f * place + phase) for f, phase in waves], 0).astype(F32)
        for place in (x, (x + 10) / 0.95)
    )
    disparity = matched(left, right, (0, 40), 9)[1]
    error = np.abs(disparity - (10 + 0.05 * x))[8:-8, 40:-12]
    assert np.median(error) < 0.1
    assert np.mean(error > 1) < 0.02


# Bad pixels of the squared difference of RGB, per cent, in windows of 11 and 21: the table that the
# data come with.
SSD = {
    "tsukuba": (11.7, 13.9),
    "venus": (15.0, 12.5),
    "teddy": (28.5, 31.7),
    "cones": (23.8, 28.7),
    "motorcycle": (29.7, 33.8),
    "aloe": (24.9, 26.9),
}


@pytest.mark.parametrize("name", SSD)
def test_better_than_squared_differences(name):
    folder = truth("stereo") / name
    left, right = (luma(read_image(folder / f"{side}.png")) for side in ("left", "right"))
    wanted = np.load(folder / "disparity.npz")["disparity"]
    searched = 0, json.loads((folder / "meta.json").read_text())["ndisp"]
    known = np.isfinite(wanted)
    for window, most in zip((11, 21), SSD[name], strict=True):
        found = matched(left, right, searched, window)[1]
        assert 100 * np.mean(np.abs(found - wanted)[known] > 1) <= most
