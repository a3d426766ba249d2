"""Calls that are repeated by their launches alone, here on the CPU: arrays of Warp and NumPy."""

import threading
from typing import Any

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern import _plans
from cvkern._runtime import runtime
from cvkern.kernels.warp import _replays as launches
from tests.calls import fields

CALLS = {
    "gaussian": lambda x: cvkern.gaussian(x, 1.5),
    "axis": lambda x: cvkern.gaussian(x, 1.5, order=1),
    "box": lambda x: cvkern.box(x, 2, mode="wrap"),
    "gradient": lambda x: cvkern.gradient(x, sigma=2.0),
    "sobel": lambda x: cvkern.sobel(x),
    "laplace": lambda x: cvkern.laplace(x),
    "canny": lambda x: cvkern.canny(x, 1.0, 0.2, 0.5),
    "quantiles": lambda x: cvkern.canny(x, 1.0, 0.7, 0.9, use_quantiles=True),
}


@pytest.fixture
def repeats(monkeypatch):
    """Return how often launches were repeated."""
    monkeypatch.setattr(_plans, "_thread", _plans._Thread())
    repeated = []
    launch = launches.Plan.launch
    monkeypatch.setattr(
        launches.Plan, "launch", lambda self, a: repeated.append(len(a)) or launch(self, a)
    )
    with cvkern.use(backend="warp"):
        yield repeated


@pytest.fixture
def planned(repeats, monkeypatch):
    """Plan calls on Warp's arrays of the CPU, and not on those of NumPy."""
    monkeypatch.setattr(
        _plans,
        "_place_of",
        lambda a: (a.shape, a.dtype, (a.ptr or 0) % 64) if isinstance(a, wp.array) else None,
    )
    return repeats


def noise(seed, shape=(40, 64)):
    return np.random.default_rng(seed).random(shape, np.float32)


def aligned(values):
    """Return a Warp array that begins like every other one."""
    room = np.empty(values.nbytes + 64, np.uint8)
    begin = -room.ctypes.data % 64
    host = room[begin : begin + values.nbytes].view(values.dtype).reshape(values.shape)
    host[...] = values
    return wp.array(host, device="cpu", copy=False)


@pytest.mark.parametrize("name", CALLS)
def test_results_are_those_of_the_call(planned, name):
    call, kept = CALLS[name], []
    for seed in range(5):
        values = noise(seed)
        image = aligned(values)
        got, want = call(image), call(values)
        assert type(got) is type(want) or isinstance(got, wp.array)
        kept.append((got, want))
        np.testing.assert_array_equal(image.numpy(), values)
    for got, want in kept:  # later calls have results of their own
        for a, b in zip(fields(got), fields(want), strict=True):
            np.testing.assert_array_equal(a.numpy().astype(b.dtype), b)
    assert len(planned) in (0, 3)
    assert planned or name in ("canny", "quantiles")  # their steps on the CPU wait for the host


def test_options_and_shapes_have_plans_of_their_own(planned):
    for sigma in (1.0, 2.0, 1.0, 2.0, 1.0, 2.0):
        for shape in ((40, 64), (20, 128)):
            values = noise(0, shape)
            got = cvkern.gaussian(aligned(values), sigma)
            np.testing.assert_array_equal(got.numpy(), cvkern.gaussian(values, sigma))
    assert len(planned) == 4


def test_what_is_no_plain_option_is_checked_each_time(planned):
    image = aligned(noise(0))
    wrong: Any = 2.0  # equal to 2 as a key
    for _ in range(4):
        cvkern.box(image, 2)
        with pytest.raises(TypeError, match="radius must be an integer"):
            cvkern.box(image, wrong)
        with pytest.raises(ValueError, match="sigma must be >= 0"):
            cvkern.gaussian(image, -1.0)
        cvkern.gaussian(image, [1.0, 2.0])
    assert len(planned) == 2


@pytest.mark.parametrize("name", [*CALLS, "median", "bytes", "resize"])
def test_small_arrays_of_numpy_are_planned(repeats, name):
    calls = {
        **CALLS,
        "median": lambda x: cvkern.median(x, 2),
        "bytes": lambda x: cvkern.gaussian(x, (1.0, 2.0), dtype=np.uint8),
        "resize": lambda x: cvkern.resize(x, (33, 20), method="area"),
    }
    call, kept = calls[name], []
    for scalar in (np.float32, np.uint8):
        for shape in ((40, 64), (40, 65), (3, 5), (700, 100)):
            for seed in range(4):
                values = (noise(seed, shape) * 255).astype(scalar)
                got = call(values)
                # A stride makes an array that is not planned.
                kept.append((got, call(np.repeat(values, 2, axis=1)[:, ::2])))
    for got, want in kept:
        for a, b in zip(fields(got), fields(want), strict=True):
            np.testing.assert_array_equal(a, b)
    # Images of 3 x 5 may be copied to longer rows; the largest are for several threads.
    assert len(repeats) >= 2 * 2 or name in ("canny", "quantiles")
    assert not repeats or name not in ("canny", "quantiles")  # may warn that there is no edge


def test_arrays_that_kernels_cannot_take_are_not_planned(repeats):
    for _ in range(4):
        cvkern.box(noise(0).astype(np.float64))
        cvkern.box(noise(0).astype(">f4"))
        cvkern.box(noise(0, (300, 300)))
        with cvkern.use(backend="taichi"):
            cvkern.box(noise(0))
    assert not repeats


@pytest.mark.parametrize("scalar", [np.uint8, np.float32])
def test_what_the_host_writes_is_not_planned(repeats, scalar):
    """The host converts bytes, and clears what floats are added to."""

    @_plans.planned
    def doubled(image):
        rt = runtime(image)
        values, result = rt.adopt(image), rt.empty(image.shape)
        summand = values
        if scalar is np.float32:
            summand = rt.zeros(image.shape)
            rt.filters.gradients.add(values, summand, summand)
        rt.filters.gradients.add(values, summand, rt.adopt(result))
        return rt.release(result)

    for n in range(5):
        np.testing.assert_array_equal(doubled(np.full((40, 64), n, scalar)), 2 * n)
    assert not repeats


def test_released_memory_ends_plans(planned):
    values = noise(0)
    for turn in range(8):
        if turn == 4:
            assert _plans._thread.plans
            cvkern.release_memory()
            assert not _plans._thread.plans
        got = cvkern.sobel(aligned(values))
        np.testing.assert_array_equal(got.numpy(), cvkern.sobel(values))
    assert len(planned) == 4  # call 5 notes its launches again


def test_memory_that_another_thread_releases_ends_plans(planned):
    values = noise(0)
    for turn in range(6):
        if turn == 4:
            thread = threading.Thread(target=cvkern.release_memory)
            thread.start()
            thread.join()
        got = cvkern.sobel(aligned(values))
        np.testing.assert_array_equal(got.numpy(), cvkern.sobel(values))
    assert len(planned) == 3  # call 4 notes its launches again


def test_plans_do_not_grow_without_end(planned, monkeypatch):
    monkeypatch.setattr(_plans, "_MOST", 4)
    image = aligned(noise(0))
    for radius in (*range(1, 9), 8, 8):
        cvkern.box(image, radius)
    assert len(_plans._thread.plans) <= 4
    assert len(planned) == 1
