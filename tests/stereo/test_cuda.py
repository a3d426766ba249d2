"""Stereo, depth and clouds on a GPU: the CPU's bits, the caller's arrays."""

import numpy as np
import pytest

import cvkern
from cvkern.clouds import turntable
from tests.on_cuda import (
    LIBRARIES,
    assert_equal_bits,
    device_of,
    give,
    noise,
    on_gpu,
    reference,
    take,
)

pytestmark = pytest.mark.usefixtures("gpu")

REPROJECTION = cvkern.reprojection_matrix(700.0, 0.12, 240.25, 130.5, -0.5)

STEREO_COSTS = ["sad", "ssd", "birchfield_tomasi", "zncc", "census", "census_symmetric"]


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 2), (37, 53, 1), (90, 200, 3)])
@pytest.mark.parametrize("cost", STEREO_COSTS)
def test_stereo_costs_are_those_of_the_cpu(cost, shape, backend):
    rng = np.random.default_rng(5)
    most = shape[1]
    for dtype in (np.uint8, np.float32):
        left, right = (256 * rng.random((2, *shape), np.float32)).astype(dtype)
        for window in (1, 5, (23, 3)):
            for disparities in ((0, min(64, most)), (max(-70, 1 - most), min(3, most))):
                options = {"cost": cost, "window": window, "channel_axis": -1}

                def call(x, y, disparities=disparities, options=options):
                    return cvkern.stereo_cost(x, y, disparities, **options)

                with cvkern.use(backend=backend, device="cuda"):
                    got = call(left, right)
                with cvkern.use(backend="warp", device="cpu"):
                    assert_equal_bits(got, call(left, right))


@pytest.mark.parametrize("library", LIBRARIES)
def test_stereo_costs_of_the_callers_arrays(library, backend):
    left, right = (noise((40, 90, 3), seed) for seed in (0, 1))
    want = cvkern.stereo_cost(left, right, (-3, 30), channel_axis=2)
    one, other = (give(library, image) for image in (left, right))
    got = cvkern.stereo_cost(one, other, (-3, 30), channel_axis=2)
    assert type(got) is type(one)
    assert device_of(got) == device_of(one)
    np.testing.assert_array_equal(take(got), want)


@pytest.mark.parametrize("paths", [4, 8, 16])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 33), (37, 53, 70), (60, 130, 128)])
def test_semi_global_is_that_of_the_cpu(shape, paths, backend):
    rng = np.random.default_rng(6)
    guide = rng.integers(0, 256, shape[:2]).astype(np.uint8)
    for dtype, p2 in ((np.uint8, 90), (np.uint8, 700), (np.uint16, 90)):
        costs = rng.integers(0, 200, shape).astype(dtype)
        for image in (None, guide):

            def call(x, image=image, p2=p2):
                sums = cvkern.aggregate_semi_global(x, 10, p2, paths=paths, guide=image)
                return sums, *cvkern.winner_take_all(sums, first=-5, uniqueness=7)

            assert_equal_bits(on_gpu(call, costs, backend), reference(call, costs))


@pytest.mark.parametrize("library", LIBRARIES)
def test_semi_global_of_the_callers_arrays(library, backend):
    rng = np.random.default_rng(7)
    costs = rng.integers(0, 200, (300, 30, 20)).astype(np.uint16)
    guide = rng.integers(0, 256, costs.shape[:2]).astype(np.uint8)
    given, image = give(library, costs), give(library, guide)
    sums = cvkern.aggregate_semi_global(given, 10, 90, guide=image)
    assert type(sums) is type(given)
    assert device_of(sums) == device_of(given)
    want = cvkern.aggregate_semi_global(costs, 10, 90, guide=guide)
    np.testing.assert_array_equal(take(sums), want)
    disparity = cvkern.winner_take_all(sums).disparity
    np.testing.assert_array_equal(take(disparity), cvkern.winner_take_all(want).disparity)
    # Strips that the volumes of eight paths over 260 rows of 32 disparities fit into.
    few = 2 * costs.size + 260 * 30 * 32 * 10
    sums = cvkern.aggregate_semi_global(given, 10, 90, guide=image, max_bytes=few)
    assert type(sums) is type(given)
    assert take(sums).shape == costs.shape


def stereo_pair(height, width, shift, seed=0):
    wide = np.random.default_rng(seed).integers(0, 256, (height, width + shift, 3), np.uint8)
    return wide[:, :width].copy(), wide[:, shift:].copy()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (60, 9), (70, 131), (440, 1024)])
@pytest.mark.parametrize("method", ["semi-global", "window"])
def test_disparities_are_those_of_the_cpu(shape, method, backend):
    left, right = stereo_pair(shape[0], shape[1], 3)
    stop = min(64, shape[1])
    for options in ({}, {"paths": 4, "uniqueness": 5, "smoothing": 3}):
        for first in (0, max(-9, 1 - shape[1])):

            def call(x, options=options, first=first):
                return cvkern.stereo_match(
                    x, right, (first, stop), method=method, channel_axis=-1, **options
                )

            assert_equal_bits(on_gpu(call, left, backend), reference(call, left))


@pytest.mark.parametrize("library", LIBRARIES)
def test_disparities_of_the_callers_arrays(library, backend):
    pair = stereo_pair(90, 120, 7)
    given = give(library, pair[0]), give(library, pair[1])
    got = cvkern.stereo_match(*given, (0, 32), channel_axis=2)
    want = cvkern.stereo_match(*pair, (0, 32), channel_axis=2)
    for a, b in zip(got, want, strict=True):
        assert type(a) is type(given[0])
        assert device_of(a) == device_of(given[0])
        np.testing.assert_array_equal(take(a), b)


def test_stacks(backend):
    """The pairs of odd sizes begin at any address."""
    torch = pytest.importorskip("torch")
    pairs = [stereo_pair(33, 71, 3 + n, n) for n in range(3)]
    left, right = (np.stack(images) for images in zip(*pairs, strict=True))
    for images in ((left, right), (left[..., 0].copy(), right[..., 0].copy())):
        for method in ("semi-global", "window"):
            given = [torch.from_numpy(i).cuda() for i in images]
            got = cvkern.stereo_match(given[0], given[1], (0, 16), method=method, batch_axis=0)
            want = cvkern.stereo_match(*images, (0, 16), method=method, batch_axis=0)
            for a, b in zip(got, want, strict=True):
                np.testing.assert_array_equal(a.cpu().numpy(), b)


@pytest.mark.parametrize("library", ["numpy", *LIBRARIES])
def test_a_matcher_follows_a_video(library, backend):
    place = "cuda" if library == "numpy" else "cpu"
    with cvkern.StereoMatcher((90, 120, 3), (0, 32), channel_axis=2) as matcher:
        for seed in range(3):
            pair = stereo_pair(90, 120, 3 + seed, seed)
            given = pair if library == "numpy" else [give(library, image) for image in pair]
            with cvkern.use(device=place):
                got = matcher(*given)
            want = cvkern.stereo_match(*pair, (0, 32), channel_axis=2)
            for a, b in zip(got, want, strict=True):
                assert type(a) is type(given[0])
                np.testing.assert_array_equal(a if library == "numpy" else take(a), b)


def _cloud(disparity):
    shades = np.random.default_rng(3).integers(0, 256, disparity.shape, np.uint8)
    return cvkern.point_cloud(disparity, REPROJECTION, shades, disparity > 0.6)


def test_clouds_are_those_of_the_cpu(backend):
    assert_equal_bits(on_gpu(_cloud, noise(), backend), reference(_cloud, noise()))
    cloud = reference(_cloud, noise())

    def movie(points):
        return turntable(points, cloud.colors, shape=(90, 120), frames=5)

    got, want = on_gpu(movie, cloud.points, backend), reference(movie, cloud.points)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_clouds_of_the_callers_arrays(library, backend):
    disparity, shades = noise(), np.full((270, 481), 7, np.uint8)
    valid = disparity > 0.6
    want = reference(lambda x: cvkern.point_cloud(x, REPROJECTION, shades, valid), disparity)
    given = [give(library, a) for a in (disparity, shades, valid)]
    got = cvkern.point_cloud(given[0], REPROJECTION, *given[1:])
    for a, b in zip(got, want, strict=True):
        assert type(a) is type(given[0])
        np.testing.assert_array_equal(take(a), b)
