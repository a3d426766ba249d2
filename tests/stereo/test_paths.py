"""Semi-global aggregation and winner takes all, against NumPy pixel by pixel and closed forms."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern._runtime import runtime
from cvkern.kernels.codes.stereo import (
    CENSUS_BITS,
    LARGEST_MATCH_COST,
    Penalties,
    Rule,
    Subpixel,
    View,
    Winners,
)
from cvkern.kernels.warp.stereo.paths import _steps_cpu as steps
from cvkern.stereo._strips import OVERLAP, cut_strips
from cvkern.stereo.paths import penalties
from tests.stereo import reference_paths as reference


def volume(*shape: int, dtype: Any = np.uint8, most: int = 200, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, most, shape, endpoint=True).astype(dtype)


def shades(*shape, seed=0):
    """An image with edges of every height, and flat parts."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < 0.5, 90, rng.integers(0, 256, shape)).astype(np.uint8)


def pick_right(costs, first):
    rt = runtime(costs)
    index = rt.empty(costs.shape[:2], np.int32)
    rt.stereo.winners.pick_right(rt.adopt(costs, costs.dtype), first, rt.adopt(index, np.int32))
    return rt.release(index)


def same_bits(a, b):
    assert a.dtype == b.dtype
    np.testing.assert_array_equal(a.view(f"u{a.itemsize}"), b.view(f"u{b.itemsize}"))


# --- aggregation ---------------------------------------------------------------------------------

SHAPES = [
    (1, 1, 1),
    (1, 23, 5),
    (19, 1, 33),
    (2, 2, 2),
    (3, 50, 64),
    (40, 9, 31),
    (17, 35, 70),
    (170, 1, 3),
    (130, 40, 2),
]


@pytest.mark.parametrize("paths", [4, 8, 16])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_sums(backend, dtype, shape, paths):
    costs = volume(*shape, dtype=dtype)
    got = cvkern.aggregate_semi_global(costs, 10, 90, paths=paths)
    assert got.dtype == np.uint16
    want = reference.aggregate(costs, None, 10, [90], paths)
    np.testing.assert_array_equal(got, want)


def test_every_number_of_disparities(backend):
    for depth in range(1, 71):
        costs = volume(4, 5, depth, seed=depth)
        got = cvkern.aggregate_semi_global(costs, 7, 60)
        np.testing.assert_array_equal(got, reference.aggregate(costs, None, 7, [60], 8))


@pytest.mark.parametrize("depth", [128, 250, 1100])
def test_many_disparities(backend, depth):
    costs = volume(5, 7, depth)
    got = cvkern.aggregate_semi_global(costs, 7, 60)
    np.testing.assert_array_equal(got, reference.aggregate(costs, None, 7, [60], 8))


@pytest.mark.parametrize("paths", [4, 8, 16])
@pytest.mark.parametrize("contrast", [0.5, 16.0, 1e4])
def test_penalties_follow_a_guide(backend, contrast, paths):
    costs, guide = volume(21, 26, 19, seed=1), shades(21, 26)
    got = cvkern.aggregate_semi_global(costs, 8, 120, paths=paths, guide=guide, contrast=contrast)
    table = [max(8, math.floor(120 * contrast / (contrast + g))) for g in range(256)]
    np.testing.assert_array_equal(got, reference.aggregate(costs, guide, 8, table, paths))


@pytest.mark.parametrize(("p1", "p2"), [(0, 0), (0, 500), (37, 37), (1, 2), (7000, 7900)])
def test_penalties(backend, p1, p2):
    costs = volume(12, 11, 40, most=255)
    got = cvkern.aggregate_semi_global(costs, p1, p2)
    np.testing.assert_array_equal(got, reference.aggregate(costs, None, p1, [p2], 8))


@pytest.mark.parametrize(("paths", "largest"), [(4, 16383), (8, 8191), (16, 4095)])
def test_sums_up_to_the_last(backend, paths, largest):
    """Every path of a volume of one cost is that cost: with no penalties, sums reach 65535."""
    costs = np.full((9, 8, 33), largest, np.uint16)
    costs[4, 4] -= 1
    costs[4, 4, 7] += 1
    got = cvkern.aggregate_semi_global(costs, 0, 0, paths=paths)
    np.testing.assert_array_equal(got, reference.aggregate(costs, None, 0, [0], paths))
    assert got.max() == paths * largest
    largest_p2 = 65535 // paths - 100
    costs = volume(9, 8, 33, dtype=np.uint16, most=100)
    got = cvkern.aggregate_semi_global(costs, largest_p2 // 2, largest_p2, paths=paths)
    want = reference.aggregate(costs, None, largest_p2 // 2, [largest_p2], paths)
    np.testing.assert_array_equal(got, want)


def test_no_penalty_sums_the_costs_themselves(backend):
    """With P2 = 0 the cheapest way from the last pixel is free, whatever its disparity."""
    costs = volume(14, 15, 20)
    got = cvkern.aggregate_semi_global(costs, 0, 0, paths=16)
    np.testing.assert_array_equal(got, 16 * costs.astype(int))


def test_paths_are_symmetric(backend):
    """Turning or mirroring the image, or the disparities, does so with the sums."""
    costs = volume(18, 18, 12, seed=3)
    for paths in (4, 8, 16):
        sums = cvkern.aggregate_semi_global(costs, 9, 70, paths=paths)
        for turned in (
            lambda x: x[::-1],
            lambda x: x[:, ::-1],
            lambda x: x.swapaxes(0, 1),
            lambda x: x[:, :, ::-1],
        ):
            again = cvkern.aggregate_semi_global(turned(costs), 9, 70, paths=paths)
            np.testing.assert_array_equal(again, turned(sums))


def test_as_many_threads_as_one(monkeypatch):
    costs, guide = volume(70, 300, 40), shades(70, 300)
    answers = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
        answers.append(cvkern.aggregate_semi_global(costs, 9, 70, paths=16, guide=guide))
        answers.append(pick_right(answers[-1], -3))
        answers.append(cvkern.winner_take_all(answers[-2], uniqueness=5).disparity)
    for i, answer in enumerate(answers):
        same_bits(answer, answers[i % 3])


def test_largest_cost_is_found(backend):
    costs = volume(5, 6, 40, dtype=np.uint16, most=8000)
    costs[4, 5, 39] = 8092
    found = cvkern.aggregate_semi_global(costs, 5, 99)
    stated = cvkern.aggregate_semi_global(costs, 5, 99, largest_cost=8092)
    np.testing.assert_array_equal(found, stated)
    costs[4, 5, 39] += 1
    with pytest.raises(ValueError, match=r"got 8 \* \(8093 \+ 99\) = 65536"):
        cvkern.aggregate_semi_global(costs, 5, 99)


def test_inputs_are_never_written(backend):
    costs, guide = volume(9, 8, 7), shades(9, 8)
    costs.flags.writeable = guide.flags.writeable = False
    before = costs.copy(), guide.copy()
    sums = cvkern.aggregate_semi_global(costs, 5, 99, guide=guide)
    cvkern.winner_take_all(sums)
    np.testing.assert_array_equal(costs, before[0])
    np.testing.assert_array_equal(guide, before[1])


@pytest.mark.parametrize("p1", [0, 20, 255 - LARGEST_MATCH_COST])
@pytest.mark.parametrize("p2", [255 - LARGEST_MATCH_COST, 256 - LARGEST_MATCH_COST])
def test_matching_where_bytes_just_suffice(backend, p1, p2):
    """Paths add up to P2 to a cost: 255 is a byte, 256 is not."""
    rng = np.random.default_rng(8)
    differ = rng.random((2, 21, 60)) < 0.5
    bits = np.where(differ, np.uint64(2**CENSUS_BITS - 1), np.uint64(0))
    gray = np.where(differ, 255, 0).astype(np.uint8)
    rt, shape = runtime(gray), differ.shape[1:]
    costs = np.empty((*shape, 37), np.uint8)
    left, right = (
        View(rt.adopt(words, np.uint64), rt.adopt(shades, np.uint8))
        for words, shades in zip(bits, gray, strict=True)
    )
    rt.stereo.paths.matching.match_costs(left, right, -2, rt.adopt(costs, np.uint8))
    assert (costs.min(), costs.max()) == (0, LARGEST_MATCH_COST)
    table = np.full(256, p2, np.uint16)
    results = [np.empty(shape, t) for t in ("i4", "f4", "f4", "f4", "i4")]
    *winners, right_index = (rt.adopt(a, a.dtype) for a in results)
    rule, costs_of = Rule(-2, Subpixel.NONE, 0), Penalties(p1, rt.constant(table), p2)
    rt.stereo.paths.matching.match(
        left, right, 37, costs_of, 8, rule, 0, Winners(*winners), right_index
    )
    sums = reference.aggregate(costs, gray[0], p1, table, 8)
    for got, want in zip(results, reference.pick(sums, -2, "none", 0), strict=False):
        np.testing.assert_allclose(
            got, want, rtol=0, atol=2**-23
        )  # confidences are rounded; the rest is equal
    np.testing.assert_array_equal(results[4], reference.pick_right(sums, -2))


# --- memory --------------------------------------------------------------------------------------


def test_strips_of_rows(backend):
    """A strip is the aggregation of the rows it sees, of which its own are kept."""
    costs, guide = volume(400, 9, 6), shades(400, 9)
    costs[3:] = 20  # what rows know, they know from the first ones
    shape, table = costs.shape, penalties(9, 70, 16.0)
    whole = reference.aggregate(costs, guide, 9, table, 8)
    work = runtime(costs).stereo.paths.aggregation.aggregation_bytes
    enough = 2 * costs.size + work("cpu", *shape, paths=8, p2=70)
    options = {"guide": guide, "contrast": 16.0}
    got = cvkern.aggregate_semi_global(costs, 9, 70, max_bytes=enough, **options)
    np.testing.assert_array_equal(got, whole)
    got = cvkern.aggregate_semi_global(costs, 9, 70, max_bytes=enough - 1, **options)
    strips = cut_strips(
        400,
        2 * costs.size,
        lambda n: work("cpu", n, *shape[1:], paths=8, p2=70),
        enough - 1,
        "",
    )
    assert len(strips) > 1
    for strip in strips:
        rows = slice(max(0, strip.top - OVERLAP), strip.bottom + OVERLAP)
        want = reference.aggregate(costs[rows], guide[rows], 9, table, 8)
        kept = want[strip.top - rows.start :][: strip.bottom - strip.top]
        np.testing.assert_array_equal(got[strip.top : strip.bottom], kept)
    assert not np.array_equal(got, whole)


@pytest.mark.parametrize("height", [1, 64, 65, 192, 193, 1000])
def test_strips_cover_every_row_once(height):
    for max_bytes in (None, 10**9, 400, 200, 193):
        strips = cut_strips(height, 1, lambda n: n, max_bytes, "")
        assert [s.top for s in strips] == [0, *(s.bottom for s in strips[:-1])]
        assert strips[-1].bottom == height
        for s in strips:
            assert 0 <= s.first <= s.top < s.bottom <= s.last <= height
            assert max_bytes is None or 1 + s.last - s.first <= max_bytes
            assert s.first in (0, s.top - OVERLAP)
            assert s.last in (height, s.bottom + OVERLAP)


# --- winners -------------------------------------------------------------------------------------


def lines(dtype, most, seed=0):
    """Costs with ties, rivals, equal ones, and winners at both ends."""
    rng = np.random.default_rng(seed)
    for depth in (*range(1, 8), 31, 32, 33, 64, 70, 200):
        costs = rng.integers(0, most, (5, 23, depth), endpoint=True).astype(dtype)
        costs[0] = most
        costs[1] //= max(1, most // 3)
        yield costs


@pytest.mark.parametrize(("dtype", "most"), [(np.uint8, 255), (np.uint16, 65535), (np.uint16, 900)])
@pytest.mark.parametrize("subpixel", [False, True, "equiangular"])
@pytest.mark.parametrize("uniqueness", [0, 15])
def test_winners(backend, uniqueness, subpixel, dtype, most):
    fit = {False: "none", True: "parabola"}.get(subpixel, subpixel)
    for costs in lines(dtype, most):
        got = cvkern.winner_take_all(costs, first=-9, subpixel=subpixel, uniqueness=uniqueness)
        _, disparity, cost, confidence = reference.pick(costs, -9, fit, uniqueness)
        np.testing.assert_array_equal(got.cost, cost)
        np.testing.assert_array_equal(np.isnan(got.disparity), np.isnan(disparity))
        # A quotient rounded to 24 bits, then a sum: 2^-24 of each result, which are below 2^8, 1.
        np.testing.assert_allclose(got.disparity, disparity, rtol=0, atol=2**-24 + 2**-17)
        np.testing.assert_allclose(got.confidence, confidence, rtol=0, atol=2**-23)


def test_winners_of_real_costs(backend):
    costs = np.random.default_rng(2).random((6, 19, 41)).astype(np.float32)
    costs[2, 3, 5:] = np.inf
    costs[2, 4] = np.inf
    costs[2, 5, ::2] = np.nan
    costs[2, 6, 7] = -1
    got = cvkern.winner_take_all(costs, uniqueness=3)
    filled = np.where(np.isnan(costs), np.float32(np.inf), costs)
    _, disparity, cost, confidence = reference.pick(filled, 0, "parabola", 3)
    np.testing.assert_array_equal(got.cost, cost)
    # A difference of numbers below 1 is within 2^-25 of them; a fit moves by that over the sum m
    # of two such, and m > 1e-3 here.
    np.testing.assert_allclose(got.disparity, disparity, rtol=0, atol=2**-18 + 2**-24 / 1e-3)
    np.testing.assert_allclose(got.confidence[3:], confidence[3:], rtol=0, atol=2**-23)
    assert got.disparity[2, 4] == 0
    assert got.confidence[2, 4] == 0
    assert got.confidence[2, 6] == 1
    finite = np.nan_to_num(costs * 50, posinf=99)
    for dtype in (np.float64, np.float16, np.int64, bool):
        again = cvkern.winner_take_all(finite.astype(dtype))
        want = cvkern.winner_take_all(finite.astype(dtype).astype(np.float32))
        for a, b in zip(again, want, strict=True):
            np.testing.assert_array_equal(a, b)


def test_ties_go_to_the_smallest_disparity(backend):
    for depth in (2, 5, 40, 129):
        for dtype in (np.uint8, np.uint16, np.float32):
            costs = np.full((2, depth, depth), 9, dtype)
            for k in range(depth):
                costs[:, k, k:] = 3
            got = cvkern.winner_take_all(costs, first=5, subpixel=False)
            np.testing.assert_array_equal(got.disparity, [5 + np.arange(depth)] * 2)


def test_uniqueness_is_a_percentage(backend):
    costs = np.array([[[100, 80, 100, 100]]], np.uint16)  # a rival is a quarter above
    for uniqueness, unique in ((19, True), (20, True), (21, False), (99, False)):
        got = cvkern.winner_take_all(costs, uniqueness=uniqueness)
        assert np.isnan(got.disparity[0, 0]) != unique
        assert got.confidence[0, 0] == np.float32(1) - np.float32(0.8)
    beside = np.array([[[80, 80, 100, 80]]], np.uint16)
    assert cvkern.winner_take_all(beside[..., :3], uniqueness=20).disparity[0, 0] == 0
    assert np.isnan(cvkern.winner_take_all(beside, uniqueness=1).disparity[0, 0])


@pytest.mark.parametrize("at", [-0.5, -0.4, -0.1, 0.0, 0.2, 0.499])
def test_fits_find_the_lowest_point(backend, at):
    """Of a parabola, and of two lines that rise alike, the lowest point is known."""
    d = np.arange(-4, 5)
    parabola = (d - at) ** 2
    lines = 3 * np.abs(d - at)
    costs = np.stack([parabola, lines]).astype(np.float32)[:, None]
    # Costs up to 30 are rounded by 2^-20, over m >= 1; results below 8 by 2^-22.
    got = cvkern.winner_take_all(costs, first=-4).disparity[0, 0]
    assert got == pytest.approx(at, abs=2**-18)
    got = cvkern.winner_take_all(costs, first=-4, subpixel="equiangular").disparity[1, 0]
    assert got == pytest.approx(at, abs=2**-18)


def test_no_fit_at_the_ends(backend):
    costs = np.array([[[1, 2, 3], [3, 2, 1], [1, 1, 1]]], np.uint8)
    np.testing.assert_array_equal(cvkern.winner_take_all(costs).disparity, [[0, 2, 0]])


@pytest.mark.parametrize("first", [-200, -41, -13, 0, 6, 40, 59, 200])
@pytest.mark.parametrize(("dtype", "most"), [(np.uint8, 255), (np.uint16, 65535), (np.float32, 7)])
def test_winners_of_the_right_image(backend, dtype, most, first):
    for depth in (1, 2, 31, 33, 100):
        costs = volume(3, 60, depth, dtype=dtype, most=most)
        costs[1] = most
        costs[2] //= max(1, most // 3)
        got = pick_right(costs, first)
        np.testing.assert_array_equal(got, reference.pick_right(costs, first))


# --- both ----------------------------------------------------------------------------------------


def test_a_noisy_plane_comes_out_flat(backend):
    """A slanted plane in noise: aggregation mends what single pixels get wrong."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:60, :80]
    truth = 4 + 0.1 * x + 0.05 * y
    cone = 12 * np.abs(np.arange(24) - truth[..., None])
    costs = np.minimum(cone, 60) + rng.uniform(0, 48, (60, 80, 24))
    costs = costs.astype(np.uint8)
    alone = cvkern.winner_take_all(costs).disparity
    sums = cvkern.aggregate_semi_global(costs, 25, 60)
    together = cvkern.winner_take_all(sums).disparity
    assert (np.abs(alone - truth) > 1).mean() > 0.2
    assert (np.abs(together - truth) > 1).mean() < 0.02


@pytest.mark.parametrize("name", ["torch", "warp", "jax", "cupy"])
def test_arrays_of_other_libraries(name):
    if name == "cupy":
        pytest.skip("needs a CUDA device: tests/stereo/test_cuda.py")
    xp = pytest.importorskip(name)
    costs, guide = volume(9, 12, 20, dtype=np.uint16), shades(9, 12)
    give = {"torch": lambda a: xp.from_numpy(a), "warp": lambda a: xp.array(a, device="cpu"),
            "jax": lambda a: xp.numpy.asarray(a)}[name]  # fmt: skip
    sums = cvkern.aggregate_semi_global(give(costs), 9, 70, guide=give(guide))
    assert type(sums).__module__.partition(".")[0] in (name, "jaxlib")
    want = cvkern.aggregate_semi_global(costs, 9, 70, guide=guide)
    np.testing.assert_array_equal(np.asarray(sums if name != "warp" else sums.numpy()), want)
    winner = cvkern.winner_take_all(sums)
    got = winner.disparity.numpy() if name == "warp" else np.asarray(winner.disparity)
    np.testing.assert_array_equal(got, cvkern.winner_take_all(want).disparity)


@pytest.mark.parametrize("paths", [8, 16])
def test_tasks_grow_with_the_rows(paths):
    """Blocks without a pixel are no tasks: a high image would have a square of them."""
    for some, _ in steps.sweeps(paths):
        _, (strips, blocks, _) = steps.begin(some, steps.WORD, (2**12, 1, 1), wp.get_device("cpu"))
        assert strips * blocks <= 2 * 2**12 // steps.STRIP
