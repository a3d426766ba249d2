"""What only a GPU shows: the CPU's bits, the caller's stream, the caller's arrays, no waiting."""

import os
import warnings

import numpy as np
import pytest
from calls import TABLE
from test_radiance_hash import Trial

import cvkern
from cvkern.clouds import turntable
from cvkern.radiance import sampled

# JAX would take most of the memory that torch, CuPy and Warp work in.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

SHAPES = [(1, 1), (1, 9), (13, 1), (37, 53), (270, 481), (1080, 1920)]
MODES = ["reflect", "constant", "nearest", "mirror", "wrap"]
LIBRARIES = ["torch", "cupy", "jax", "warp"]
TENTH_OF_A_SECOND = 200_000_000  # GPU clock cycles, more or less

REPROJECTION = cvkern.reprojection_matrix(700.0, 0.12, 240.25, 130.5, -0.5)

CALLS = {
    "gaussian": lambda x: cvkern.gaussian(x, 2.0),
    "derivative": lambda x: cvkern.gaussian(x, 1.5, order=1),
    "correlate_separable": lambda x: cvkern.correlate_separable(x, [0.5, -1.0, 0.25]),
    "box": lambda x: cvkern.box(x, 3),
    "median": lambda x: cvkern.median(x, 2),
    "sobel": cvkern.sobel,
    "scharr": cvkern.scharr,
    "gradient": lambda x: cvkern.gradient(x, sigma=1.5),
    "gradient_sobel": lambda x: cvkern.gradient(x, sigma=0.0, operator="sobel"),
    "canny": lambda x: cvkern.canny(x, 1.5, 0.02, 0.06),
    "canny_l1": lambda x: cvkern.canny(x, 1.5, 0.02, 0.06, norm="l1"),
    "canny_sobel": lambda x: cvkern.canny(x, 1.0, 0.5, 1.0, operator="sobel"),
    "hough_circle": lambda x: cvkern.hough_circle(x > 0.9, [2, 7, 12], full_output=True),
    "hough_circle_votes": lambda x: cvkern.hough_circle(
        x > 0.9, 9, normalize=False, full_output=True
    ),
    "hough_circle_directed": lambda x: cvkern.hough_circle(
        x > 0.9, [2, 9], full_output=True, orientation=6 * x - 3
    ),
    "hough_circle_arcs": lambda x: cvkern.hough_circle(
        x > 0.9, [2, 9], full_output=True, orientation=6 * x - 3, orientation_tolerance=0.2
    ),
    "hough_circle_peaks": lambda x: cvkern.hough_circle_peaks(
        cvkern.hough_circle(x > 0.9, [2, 9], full_output=True), [2, 9], 3, 2
    ),
    "hough_ellipse": lambda x: cvkern.hough_ellipse(x[:40, :50] > 0.95, 3),
    "hough_line": lambda x: cvkern.hough_line(x > 0.7).votes,
    "hough_line_slope": lambda x: cvkern.hough_line_slope(x > 0.7)[:2],
    "hough_line_directed": lambda x: (
        cvkern.hough_line(x > 0.7, orientation=x, orientation_tolerance=0.1, weights=x).votes
    ),
    "hough_line_peaks": lambda x: cvkern.hough_line_peaks(*cvkern.hough_line(x > 0.7)).votes,
    "generalized_hough": lambda x: cvkern.generalized_hough(
        x, TABLE, rotations=8, scales=[0.8, 1.1], threshold=0, num_peaks=3
    ),
    "generalized_hough_votes": lambda x: cvkern.generalized_hough_votes(x, TABLE, rotations=3),
    "disparity_to_depth": lambda x: cvkern.disparity_to_depth(x, 700.0, 0.12, -0.5),
    "points_from_disparity": lambda x: cvkern.points_from_disparity(x, REPROJECTION),
    "left_right_check": lambda x: cvkern.left_right_check(x, x, tolerance=0.3),
    "remove_speckles": lambda x: cvkern.remove_speckles(x, 9, difference=0.3),
    "fill_disparity": lambda x: cvkern.fill_disparity(
        cvkern.remove_speckles(x, 99, difference=0.3)
    ),
}

STEREO_COSTS = ["sad", "ssd", "birchfield_tomasi", "zncc", "census", "census_symmetric"]


@pytest.fixture(scope="module", autouse=True)
def _gpu():
    warp = pytest.importorskip("warp")
    warp.init()
    if warp.get_cuda_device_count() == 0:
        pytest.skip("needs a CUDA device")


@pytest.fixture(params=["warp", "taichi"])
def kernels(request):
    """Run the test once per kernel set; arrays on the GPU stay there."""
    pytest.importorskip(request.param)
    with cvkern.use(backend=request.param, device="cpu"):
        yield request.param


def noise(shape=(270, 481), seed=0):
    return np.random.default_rng(seed).random(shape, np.float32)


def reference(call, image):
    """Compute on the CPU with Warp: the bits that every device must give."""
    with cvkern.use(backend="warp", device="cpu"):
        return call(image)


def on_gpu(call, image, backend):
    with cvkern.use(backend=backend, device="cuda"):
        return call(image)


def fields(answer):
    return answer if isinstance(answer, tuple) else (answer,)


def assert_equal_bits(got, expected):
    for a, b in zip(fields(got), fields(expected), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a.view(np.uint8), b.view(np.uint8))


def give(library, image):
    """Put `image` on the GPU as an array of `library`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX takes a warning on its way to the GPU for a failure
        xp = pytest.importorskip(library)
        if library == "jax":
            return xp.device_put(image, xp.devices("gpu")[0])
    if library == "torch":
        return xp.from_numpy(image.copy()).cuda()
    if library == "cupy":
        return xp.asarray(image)
    return xp.array(image, device="cuda")


def take(array):
    """Bring an array of any library to the host."""
    if hasattr(array, "get"):  # CuPy
        return array.get()
    if hasattr(array, "cpu"):  # torch
        return array.cpu().numpy()
    return array.numpy() if hasattr(array, "numpy") else np.asarray(array)


def device_of(array):
    kind, index = array.__dlpack_device__()
    return int(kind), int(index)


# --- the bits of the CPU -------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", CALLS)
def test_bits_are_those_of_the_cpu(name, shape, kernels):
    image = noise(shape)
    assert_equal_bits(on_gpu(CALLS[name], image, kernels), reference(CALLS[name], image))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sigma", [0.4, 3.0, 20.0])
def test_gaussian_bits_at_every_border(sigma, mode, kernels):
    image = noise((61, 45))

    def call(x):
        return cvkern.gaussian(x, sigma, mode=mode, cval=0.3)

    assert_equal_bits(on_gpu(call, image, kernels), reference(call, image))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_gaussian_bits_with_channels(channels, kernels):
    image = noise((50, 67, channels))

    def call(x):
        return cvkern.gaussian(x, 2.0, channel_axis=-1)

    assert_equal_bits(on_gpu(call, image, kernels), reference(call, image))


@pytest.mark.parametrize("norm", ["l1", "l2"])
@pytest.mark.parametrize("shape", [(5, 7), (270, 481), (1080, 1920), (2160, 3840)])
def test_canny_is_that_of_opencv(shape, norm, kernels):
    cv2 = pytest.importorskip("cv2")
    image = np.random.default_rng(1).integers(0, 256, shape, np.uint8)
    smooth = cv2.GaussianBlur(image, (0, 0), 3.0)
    smooth = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)  # long, winding edges
    for x, low, high in ((image, 300, 700), (smooth, 30, 120)):
        got = on_gpu(
            lambda x, low=low, high=high: cvkern.canny(
                x, 0.0, low, high, operator="sobel", norm=norm, mode="nearest"
            ),
            x,
            kernels,
        )
        assert got.dtype == bool
        np.testing.assert_array_equal(got, cv2.Canny(x, low, high, L2gradient=norm == "l2") > 0)


def test_hysteresis_follows_a_long_spiral(kernels):
    """One strong pixel must light a weak chain that winds through the whole image."""
    cv2 = pytest.importorskip("cv2")
    image = np.zeros((1024, 1024), np.uint8)
    turns = np.linspace(0, 40 * 2 * np.pi, 20000)
    points = 512 + np.stack([np.cos(turns), np.sin(turns)], 1) * np.linspace(5, 500, 20000)[:, None]
    cv2.polylines(image, [points.round().astype(np.int32)], False, 40, 2)
    image[510:515, 515:520] = 255

    def call(x):
        return cvkern.canny(x, 0.0, 60.0, 600.0, operator="sobel", norm="l1", mode="nearest")

    expected = cv2.Canny(image, 60.0, 600.0) > 0
    assert expected.sum() > 10_000
    for _ in range(5):  # a race shows as an answer that changes
        np.testing.assert_array_equal(on_gpu(call, image, kernels), expected)


def test_subpixel_edges_are_those_of_the_cpu(kernels):
    image = noise((270, 481))

    def call(x):
        return cvkern.subpixel_edges(x, 2.0, 0.02, 0.04)

    got, expected = on_gpu(call, image, kernels), reference(call, image)
    assert len(expected.points) > 100
    assert len(got.points) == len(expected.points)
    # The logarithm is each device's own, within a few units in the last place.
    np.testing.assert_allclose(got.points, expected.points, rtol=0, atol=1e-3)
    assert_equal_bits((got.orientation, got.strength), (expected.orientation, expected.strength))


def _cloud(disparity):
    shades = np.random.default_rng(3).integers(0, 256, disparity.shape, np.uint8)
    return cvkern.point_cloud(disparity, REPROJECTION, shades, disparity > 0.6)


def test_clouds_are_those_of_the_cpu(kernels):
    assert_equal_bits(on_gpu(_cloud, noise(), kernels), reference(_cloud, noise()))
    cloud = reference(_cloud, noise())

    def movie(points):
        return turntable(points, cloud.colors, shape=(90, 120), frames=5)

    got, want = on_gpu(movie, cloud.points, kernels), reference(movie, cloud.points)
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_clouds_of_the_callers_arrays(library, kernels):
    disparity, shades = noise(), np.full((270, 481), 7, np.uint8)
    valid = disparity > 0.6
    want = reference(lambda x: cvkern.point_cloud(x, REPROJECTION, shades, valid), disparity)
    given = [give(library, a) for a in (disparity, shades, valid)]
    got = cvkern.point_cloud(given[0], REPROJECTION, *given[1:])
    for a, b in zip(got, want, strict=True):
        assert type(a) is type(given[0])
        np.testing.assert_array_equal(take(a), b)


# --- the caller's arrays -------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 2), (37, 53, 1), (90, 200, 3)])
@pytest.mark.parametrize("cost", STEREO_COSTS)
def test_stereo_costs_are_those_of_the_cpu(cost, shape, kernels):
    rng = np.random.default_rng(5)
    most = shape[1]
    for dtype in (np.uint8, np.float32):
        left, right = (256 * rng.random((2, *shape), np.float32)).astype(dtype)
        for window in (1, 5, (23, 3)):
            for disparities in ((0, min(64, most)), (max(-70, 1 - most), min(3, most))):
                options = {"cost": cost, "window": window, "channel_axis": -1}

                def call(x, y, disparities=disparities, options=options):
                    return cvkern.stereo_cost(x, y, disparities, **options)

                with cvkern.use(backend=kernels, device="cuda"):
                    got = call(left, right)
                with cvkern.use(backend="warp", device="cpu"):
                    assert_equal_bits(got, call(left, right))


@pytest.mark.parametrize("library", LIBRARIES)
def test_stereo_costs_of_the_callers_arrays(library, kernels):
    left, right = (noise((40, 90, 3), seed) for seed in (0, 1))
    want = cvkern.stereo_cost(left, right, (-3, 30), channel_axis=2)
    one, other = (give(library, image) for image in (left, right))
    got = cvkern.stereo_cost(one, other, (-3, 30), channel_axis=2)
    assert type(got) is type(one)
    assert device_of(got) == device_of(one)
    np.testing.assert_array_equal(take(got), want)


@pytest.mark.parametrize("paths", [4, 8, 16])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 33), (37, 53, 70), (60, 130, 128)])
def test_semi_global_is_that_of_the_cpu(shape, paths, kernels):
    rng = np.random.default_rng(6)
    guide = rng.integers(0, 256, shape[:2]).astype(np.uint8)
    for dtype, p2 in ((np.uint8, 90), (np.uint8, 700), (np.uint16, 90)):
        costs = rng.integers(0, 200, shape).astype(dtype)
        for image in (None, guide):

            def call(x, image=image, p2=p2):
                sums = cvkern.aggregate_semi_global(x, 10, p2, paths=paths, guide=image)
                return sums, *cvkern.winner_take_all(sums, first=-5, uniqueness=7)

            assert_equal_bits(on_gpu(call, costs, kernels), reference(call, costs))


@pytest.mark.parametrize("library", LIBRARIES)
def test_semi_global_of_the_callers_arrays(library, kernels):
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
def test_disparities_are_those_of_the_cpu(shape, method, kernels):
    left, right = stereo_pair(shape[0], shape[1], 3)
    stop = min(64, shape[1])
    for options in ({}, {"paths": 4, "uniqueness": 5, "smoothing": 3}):
        for first in (0, max(-9, 1 - shape[1])):

            def call(x, options=options, first=first):
                return cvkern.stereo_match(
                    x, right, (first, stop), method=method, channel_axis=-1, **options
                )

            assert_equal_bits(on_gpu(call, left, kernels), reference(call, left))


@pytest.mark.parametrize("library", LIBRARIES)
def test_disparities_of_the_callers_arrays(library, kernels):
    pair = stereo_pair(90, 120, 7)
    given = give(library, pair[0]), give(library, pair[1])
    got = cvkern.stereo_match(*given, (0, 32), channel_axis=2)
    want = cvkern.stereo_match(*pair, (0, 32), channel_axis=2)
    for a, b in zip(got, want, strict=True):
        assert type(a) is type(given[0])
        assert device_of(a) == device_of(given[0])
        np.testing.assert_array_equal(take(a), b)


@pytest.mark.parametrize("library", ["numpy", *LIBRARIES])
def test_a_matcher_follows_a_video(library, kernels):
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


@pytest.mark.parametrize("name", ["gaussian", "gradient", "median", "canny"])
@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_come_back_as_they_went_in(library, name, kernels):
    image = noise()
    given = give(library, image)
    got, expected = CALLS[name](given), reference(CALLS[name], image)
    for a, b in zip(fields(got), fields(expected), strict=True):
        assert type(a) is type(given)
        assert device_of(a) == device_of(given)
        host = take(a)
        assert host.dtype == b.dtype
        np.testing.assert_array_equal(host, b)
    np.testing.assert_array_equal(take(given), image)  # inputs are never written


@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_strided_and_other_dtypes(library, kernels):
    image = np.random.default_rng(2).integers(0, 256, (80, 120), np.uint8)
    for view in (np.s_[::2, ::3], np.s_[10:, 5:90]):
        got = cvkern.gaussian(give(library, image)[view], 1.0)
        assert_equal_bits(take(got), reference(lambda x: cvkern.gaussian(x, 1.0), image[view]))


@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_out_is_filled(library, kernels):
    image = noise()
    out = give(library, np.full_like(image, np.nan))  # poison: every element must be written
    assert cvkern.gaussian(give(library, image), 2.0, out=out) is out
    assert_equal_bits(take(out), reference(CALLS["gaussian"], image))


# --- the caller's stream -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gaussian", "gradient", "canny"])
def test_work_runs_on_the_callers_stream(name, kernels):
    """The input is written, late, on the stream of the call, and the result is read there."""
    torch = pytest.importorskip("torch")
    image, call = noise((1080, 1920)), CALLS[name]
    late = torch.from_numpy(image).cuda()
    x = torch.zeros_like(late)
    stream = torch.cuda.Stream()
    torch.cuda.synchronize()
    with torch.cuda.stream(stream):
        call(x)  # compiled, and its memory taken
        torch.cuda._sleep(TENTH_OF_A_SECOND)
        x.copy_(late)
        copies = [a.clone() for a in fields(call(x))]
        x.zero_()
    stream.synchronize()
    for a, b in zip(copies, fields(reference(call, image)), strict=True):
        np.testing.assert_array_equal(a.cpu().numpy(), b)


@pytest.mark.parametrize("name", ["gaussian", "gradient", "median", "canny"])
def test_a_call_does_not_wait(name):
    """A call that went through the host would have to wait for the work before it."""
    torch = pytest.importorskip("torch")
    call, x = CALLS[name], torch.from_numpy(noise((1080, 1920))).cuda()
    stream = torch.cuda.Stream()
    torch.cuda.synchronize()
    with cvkern.use(backend="warp"), torch.cuda.stream(stream):
        kept = [call(x) for _ in range(3)]
        stream.synchronize()
        torch.cuda._sleep(TENTH_OF_A_SECOND)
        kept.append(call(x))
        returned_early = not stream.query()
    stream.synchronize()
    assert returned_early
    for one in kept:
        for a, b in zip(fields(one), fields(kept[0]), strict=True):
            assert torch.equal(a, b)


def test_two_streams_do_not_share_memory(kernels):
    torch = pytest.importorskip("torch")
    images = [noise((700 + 40 * i, 900), seed=i) for i in range(2)]
    expected = [reference(CALLS["canny"], image) for image in images]
    given = [torch.from_numpy(image).cuda() for image in images]
    streams = [torch.cuda.Stream() for _ in images]
    torch.cuda.synchronize()
    found = []
    for _ in range(10):
        for i, stream in enumerate(streams):
            with torch.cuda.stream(stream):
                found.append((i, CALLS["canny"](given[i])))
    torch.cuda.synchronize()
    for i, mask in found:
        np.testing.assert_array_equal(mask.cpu().numpy(), expected[i])


def test_cupy_streams_are_followed(kernels):
    cupy = pytest.importorskip("cupy")
    image = noise((1080, 1920))
    with cupy.cuda.Stream(non_blocking=True) as stream:
        late = cupy.asarray(image)
        x = cupy.zeros_like(late)
        CALLS["gaussian"](x)
        for _ in range(200):  # keep the stream busy, so that the write below is late
            x += late
        x[...] = late
        got = CALLS["gaussian"](x).copy()
        stream.synchronize()
    assert_equal_bits(got.get(), reference(CALLS["gaussian"], image))


# --- graphs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gaussian", "gradient", "canny"])
@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_a_captured_call_follows_its_input(library, name):
    first, second = noise(seed=1), noise(seed=2)
    x = give(library, first)
    with cvkern.use(backend="warp"):
        replay = cvkern.capture(CALLS[name], x)
        before = replay()
        for image in (second, first, second):
            x[...] = give(library, image)
            got = replay()
            assert got is before
            for a, b in zip(fields(got), fields(reference(CALLS[name], image)), strict=True):
                np.testing.assert_array_equal(take(a), b)


def test_plain_calls_between_replays_do_not_disturb_them():
    torch = pytest.importorskip("torch")
    small, large = noise((64, 64)), noise((1500, 1500), seed=3)
    x, y = (torch.from_numpy(image).cuda() for image in (small, large))
    with cvkern.use(backend="warp"):
        replay = cvkern.capture(CALLS["canny"], x)
        for _ in range(3):
            mask = CALLS["canny"](y)
            np.testing.assert_array_equal(take(replay()), reference(CALLS["canny"], small))
            np.testing.assert_array_equal(take(mask), reference(CALLS["canny"], large))


# --- radiance fields -----------------------------------------------------------------------------


@pytest.mark.parametrize("unbounded", [False, True])
def test_a_hash_field_is_that_of_the_cpu(unbounded, kernels):
    here = Trial(unbounded=unbounded)
    with cvkern.use(backend=kernels, device="cuda"):
        there = Trial(unbounded=unbounded)
        found, slopes = there.look(), there.slopes()
        taken = there.field.taken()
    # Features, weights and what passes through layers have 11 digits with Warp; five layers.
    exact = kernels == "taichi"
    for got, want in zip(found, here.look(), strict=True):
        np.testing.assert_allclose(
            got, want, rtol=1e-4 if exact else 0.03, atol=1e-4 if exact else 0.03
        )
    for got, want in zip(slopes, here.slopes(), strict=True):
        off = np.linalg.norm(got - want) / np.linalg.norm(want)
        assert off < (1e-3 if exact else 0.05)
    assert taken == here.field.taken()  # the same cells, whatever the precision


@pytest.mark.parametrize("unbounded", [False, True])
def test_a_hash_field_sees_what_it_does_on_the_cpu(unbounded, kernels, monkeypatch):
    found = []
    for room in (2**16, 100):
        monkeypatch.setattr(sampled, "VIEW_ROOM", room)
        with cvkern.use(backend=kernels, device="cuda"):
            found.append(Trial(unbounded=unbounded).see())
    bound = 1e-4 if kernels == "taichi" else 0.03  # as above
    for wide, narrow, on_cpu in zip(*found, Trial(unbounded=unbounded).see(), strict=True):
        np.testing.assert_array_equal(narrow, wide)  # the same sums in the same order
        np.testing.assert_allclose(wide, on_cpu, rtol=bound, atol=bound)


# --- what must be refused ------------------------------------------------------------------------


def test_a_gpu_that_is_not_there_is_refused(kernels):
    with cvkern.use(device="cuda:99"), pytest.raises(ValueError, match="device must be"):
        cvkern.gaussian(noise(), 1.0)


@pytest.mark.parametrize("name", ["gaussian", "box", "median"])
def test_out_of_numpy_and_on_the_gpu(name):
    torch = pytest.importorskip("torch")
    function = getattr(cvkern, name)
    image = noise()
    want = function(image, 1)
    out = np.full_like(image, 7)
    with cvkern.use(device="cuda"):
        assert function(image, 1, out=out) is out
    np.testing.assert_array_equal(out, want)
    given, there = torch.from_numpy(image.copy()).cuda(), torch.zeros(image.shape, device="cuda")
    assert function(given, 1, out=there) is there
    np.testing.assert_array_equal(there.cpu().numpy(), want)
    for bad in (given, torch.zeros(image.shape[::-1], device="cuda").t(), torch.zeros(image.shape)):
        with pytest.raises(ValueError, match="out must"):
            function(given, 1, out=bad)
