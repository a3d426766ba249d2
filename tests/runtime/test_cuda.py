"""Properties that only a GPU shows: the CPU's bits, the caller's stream and arrays, no waiting."""

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern.kernels.warp import _pages, _streams
from tests.calls import TABLE, fields
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

SHAPES = [(1, 1), (1, 9), (13, 1), (37, 53), (270, 481), (1080, 1920)]
MODES = ["reflect", "constant", "nearest", "mirror", "wrap"]
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
    "canny": lambda x: cvkern.canny(x, 1.5, 0.16, 0.48),
    "canny_l1": lambda x: cvkern.canny(x, 1.5, 0.16, 0.48, norm="l1"),
    "canny_gaussian": lambda x: cvkern.canny(x, 1.0, 0.5, 1.0, operator="gaussian"),
    "canny_masked": lambda x: cvkern.canny(x, 1.5, 0.7, 0.9, x > 0.1, True, operator="gaussian"),
    "canny_quantiles": lambda x: cvkern.canny(x, 1.5, 0.7, 0.9, use_quantiles=True),
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


# --- the bits of the CPU -------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", CALLS)
def test_bits_are_those_of_the_cpu(name, shape, backend):
    image = noise(shape)
    assert_equal_bits(on_gpu(CALLS[name], image, backend), reference(CALLS[name], image))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sigma", [0.4, 3.0, 20.0])
def test_gaussian_bits_at_every_border(sigma, mode, backend):
    image = noise((61, 45))

    def call(x):
        return cvkern.gaussian(x, sigma, mode=mode, cval=0.3)

    assert_equal_bits(on_gpu(call, image, backend), reference(call, image))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_gaussian_bits_with_channels(channels, backend):
    image = noise((50, 67, channels))

    def call(x):
        return cvkern.gaussian(x, 2.0, channel_axis=-1)

    assert_equal_bits(on_gpu(call, image, backend), reference(call, image))


@pytest.mark.parametrize("norm", ["l1", "l2"])
@pytest.mark.parametrize("shape", [(5, 7), (270, 481), (1080, 1920), (2160, 3840)])
def test_canny_is_that_of_opencv(shape, norm, backend):
    cv2 = pytest.importorskip("cv2")
    image = np.random.default_rng(1).integers(0, 256, shape, np.uint8)
    smooth = cv2.GaussianBlur(image, (0, 0), 3.0)
    smooth = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)  # long, winding edges
    for x, low, high in ((image, 300, 700), (smooth, 30, 120)):
        got = on_gpu(
            lambda x, low=low, high=high: cvkern.canny(
                x, 0.0, low, high, suppression="sectors", norm=norm, mode="nearest"
            ),
            x,
            backend,
        )
        assert got.dtype == bool
        np.testing.assert_array_equal(got, cv2.Canny(x, low, high, L2gradient=norm == "l2") > 0)


def test_hysteresis_follows_a_long_spiral(backend):
    """One strong pixel must light a weak chain that winds through the whole image."""
    cv2 = pytest.importorskip("cv2")
    image = np.zeros((1024, 1024), np.uint8)
    turns = np.linspace(0, 40 * 2 * np.pi, 20000)
    points = 512 + np.stack([np.cos(turns), np.sin(turns)], 1) * np.linspace(5, 500, 20000)[:, None]
    cv2.polylines(image, [points.round().astype(np.int32)], False, 40, 2)
    image[510:515, 515:520] = 255

    def call(x):
        return cvkern.canny(x, 0.0, 60.0, 600.0, suppression="sectors", norm="l1", mode="nearest")

    expected = cv2.Canny(image, 60.0, 600.0) > 0
    assert expected.sum() > 10_000
    for _ in range(5):  # a race shows as an answer that changes
        np.testing.assert_array_equal(on_gpu(call, image, backend), expected)


def test_subpixel_edges_are_those_of_the_cpu(backend):
    image = noise((270, 481))

    def call(x):
        return cvkern.subpixel_edges(x, 2.0, 0.16, 0.32)

    got, expected = on_gpu(call, image, backend), reference(call, image)
    assert len(expected.points) > 100
    assert_equal_bits(got, expected)


# --- the caller's arrays -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gaussian", "gradient", "median", "canny"])
@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_come_back_as_they_went_in(library, name, backend):
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
def test_strided_and_other_dtypes(library, backend):
    image = np.random.default_rng(2).integers(0, 256, (80, 120), np.uint8)
    for view in (np.s_[::2, ::3], np.s_[10:, 5:90]):
        got = cvkern.gaussian(give(library, image)[view], 1.0)
        assert_equal_bits(take(got), reference(lambda x: cvkern.gaussian(x, 1.0), image[view]))


@pytest.mark.parametrize("library", ["torch", "cupy"])
def test_out_is_filled(library, backend):
    image = noise()
    out = give(library, np.full_like(image, np.nan))  # poison: every element must be written
    assert cvkern.gaussian(give(library, image), 2.0, out=out) is out
    assert_equal_bits(take(out), reference(CALLS["gaussian"], image))


# --- the caller's stream -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gaussian", "gradient", "canny"])
def test_work_runs_on_the_callers_stream(name, backend):
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


def test_copies_of_host_operands_live_as_long_as_kernels_read_them(backend):
    """Memory that is freed too early is given at once to those who allocate the same size."""
    torch = pytest.importorskip("torch")
    image = noise((300, 400))
    places = np.indices(image.shape).astype(np.float32)
    given, stream = torch.from_numpy(image).cuda(), torch.cuda.Stream()
    cvkern.remap(given, places)
    for _ in range(5):
        torch.cuda.synchronize()
        with torch.cuda.stream(stream):
            torch.cuda._sleep(TENTH_OF_A_SECOND)
            got = cvkern.remap(given, places)
        others = [wp.zeros(places.shape, dtype=wp.float32, device="cuda:0") for _ in range(4)]
        torch.cuda.synchronize()
        del others
        np.testing.assert_array_equal(got.cpu().numpy(), image)


def test_lent_memory_is_freed():
    torch = pytest.importorskip("torch")
    given = torch.from_numpy(noise()).cuda()
    with cvkern.use(backend="warp"), torch.cuda.stream(torch.cuda.Stream()):
        for _ in range(20):
            cvkern.remap(given, np.indices(given.shape))
            torch.cuda.synchronize()
    assert len(_streams._returned) <= 2
    assert not _streams._recorded


def test_two_streams_do_not_share_memory(backend):
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


def test_cupy_streams_are_followed(backend):
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


def test_results_keep_their_memory(backend, monkeypatch):
    monkeypatch.setattr(_pages, "_MOST", _pages._locked + (8 << 20))  # room for four
    images = np.random.default_rng(0).random((10, 600, 512), np.float32)  # above a megabyte each
    wanted = [cvkern.gaussian(image, 1.0) for image in images]
    with cvkern.use(device="cuda"):
        first = cvkern.gaussian(images[0], 1.0)
        view, address = first[7:9].T, first.ctypes.data
        del first
        kept = [cvkern.gaussian(image, 1.0) for image in images]
        np.testing.assert_array_equal(view, wanted[0][7:9].T)
        assert address not in [array.ctypes.data for array in kept]
        del view, kept[:5]
        kept += [cvkern.gaussian(image, 1.0) for image in images]
    for got, want in zip(kept, wanted[5:] + wanted, strict=True):
        np.testing.assert_array_equal(got, want)
    if backend == "warp":
        assert address in [array.ctypes.data for array in kept]  # used again


# --- what must be refused ------------------------------------------------------------------------


def test_a_gpu_that_is_not_there_is_refused(backend):
    with pytest.raises(ValueError, match="device must be"):
        cvkern.use(device="cuda:99")


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
