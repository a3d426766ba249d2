"""Captured calls: repeated on the new contents of their arrays, into the same memory."""

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from tests.calls import CALLS, blobs, fields, noise

KERNELS_ALONE = ["gaussian", "derivative", "correlate_separable", "box", "sobel", "scharr",
                 "gradient", "gradient_sobel", "canny", "canny_gaussian", "canny_sectors",
                 "hough_circle", "hough_line", "hough_line_slope", "stereo_match",
                 "radiance.composite_rays", "radiance.composite_rays_backward"]  # fmt: skip


@pytest.mark.parametrize("name", KERNELS_ALONE)
@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_a_replay_follows_its_input(backend, name, dtype):
    frame = blobs(25, 41).astype(dtype)
    replay = cvkern.capture(CALLS[name], frame)
    first = replay()
    for seed in (1, 2):
        frame[...] = blobs(25, 41, seed=seed)
        got = replay()
        for a, b, c in zip(fields(got), fields(first), fields(CALLS[name](frame)), strict=True):
            assert a is b
            np.testing.assert_array_equal(a, c)


def test_calls_between_replays_do_not_disturb_them(backend):
    small, large = blobs(20, 30), blobs(130, 170)
    replay = cvkern.capture(cvkern.canny, small, 1.5, 24, 64)
    want_small, want_large = cvkern.canny(small, 1.5, 24, 64), cvkern.canny(large, 1.5, 24, 64)
    for _ in range(3):
        between = cvkern.canny(large, 1.5, 24, 64)
        np.testing.assert_array_equal(replay(), want_small)
        np.testing.assert_array_equal(between, want_large)


def test_two_captures_keep_apart(backend):
    frames = [noise(20, 30, seed=seed) for seed in (1, 2)]
    replays = [cvkern.capture(cvkern.gaussian, frame, 1.5) for frame in frames]
    for replay, frame in zip(replays, frames, strict=True):
        np.testing.assert_array_equal(replay(), cvkern.gaussian(frame, 1.5))
    np.testing.assert_array_equal(replays[0](), cvkern.gaussian(frames[0], 1.5))


def test_out_and_chains_of_functions(backend):
    frame, out = noise(20, 30), np.zeros((20, 30), np.float32)
    replay = cvkern.capture(cvkern.gaussian, frame, 1.0, out=out)
    assert replay() is out

    def chain(x):
        return cvkern.sobel(cvkern.box(x, 1))

    replay = cvkern.capture(chain, frame)
    frame[...] = noise(20, 30, seed=5)
    np.testing.assert_array_equal(replay(), chain(frame))


def test_a_replay_keeps_the_kernel_set_of_its_capture():
    frame, used = blobs(20, 30), []

    def find_edges(x):
        used.append(runtime().name)
        return cvkern.canny(x)

    with cvkern.use("taichi"):
        replay = cvkern.capture(find_edges, frame)
    with cvkern.use("warp"):
        np.testing.assert_array_equal(replay(), cvkern.canny(frame))
        assert runtime().name == "warp"
    assert set(used) == {"taichi"}


def test_the_median_of_bytes_is_captured(backend):
    image = np.random.default_rng(0).integers(0, 256, (20, 30)).astype(np.uint8)
    replay = cvkern.capture(cvkern.median, image, 2)
    image[...] = image[::-1]
    np.testing.assert_array_equal(replay(), cvkern.median(image, 2))
    with pytest.raises(ValueError, match="got median of another dtype than uint8, or above"):
        cvkern.capture(cvkern.median, image, 8)


@pytest.mark.parametrize("name", ["median", "subpixel_edges"])
def test_what_is_not_kernels_alone_is_refused(backend, name):
    image = blobs(20, 30).astype(np.float32)
    with pytest.raises(ValueError, match=r"^captured functions must be kernels alone, got "):
        cvkern.capture(CALLS[name], image)
    for field in fields(CALLS[name](image)):  # and nothing of the attempt is left
        assert field.size


def test_errors_are_those_of_the_function(backend):
    with pytest.raises(ValueError, match=r"^sigma must be >= 0 and finite, got -1$"):
        cvkern.capture(cvkern.gaussian, np.zeros((3, 4)), -1)
    np.testing.assert_allclose(cvkern.gaussian(np.ones((3, 4))), 1, rtol=1e-6)
