"""The memory that calls keep for later ones: freed on request, and never above a limit."""

import ctypes
import gc
import mmap
import re
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern import _memory
from cvkern.kernels.warp import _scratch
from tests.calls import noise

SHAPE = (300, 400)


def kept():
    """Return the bytes on the host that all threads keep."""
    with _scratch._lock:
        threads = list(_scratch._threads.values())
    return sum(block.bytes_on_host for blocks in threads for block in list(blocks.values()))


@pytest.fixture(autouse=True)
def _from_nothing():
    with cvkern.use("warp"):
        cvkern.release_memory()
        yield
        cvkern.release_memory()


def test_scratch_is_given_back():
    image = noise(*SHAPE)
    want = cvkern.canny(image)
    assert kept() >= image.nbytes  # otherwise this would show nothing
    cvkern.release_memory()
    assert kept() == 0
    np.testing.assert_array_equal(cvkern.canny(image), want)


@pytest.mark.skipif(
    not Path("/sys/kernel/mm/transparent_hugepage").exists(), reason="needs huge pages of Linux"
)
def test_large_scratch_asks_for_huge_pages():
    block = _scratch.scratch("test.huge", (16 << 20,), wp.uint8, wp.get_device("cpu"))
    middle, inside = (block.ptr or 0) + (8 << 20), False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if found := re.match(r"([0-9a-f]+)-([0-9a-f]+) ", line):
            begin, end = (int(n, 16) for n in found.groups())
            inside = begin <= middle < end
        elif inside and line.startswith("VmFlags:"):
            assert "hg" in line.split()
            return
    pytest.fail("the memory of the block must be mapped")


def test_that_of_other_threads_too():
    done, end = threading.Barrier(4, timeout=60), threading.Event()

    def work():
        with cvkern.use("warp"):
            cvkern.canny(noise(*SHAPE))
            done.wait()
            end.wait(60)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    done.wait()
    assert kept() >= 3 * noise(*SHAPE).nbytes
    cvkern.release_memory()
    assert kept() == 0
    end.set()
    for thread in threads:
        thread.join()


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="needs glibc")
def test_the_system_gets_it_back():
    """The allocator of each thread would keep what is freed: a few MiB of each megapixel."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE

    done, end = threading.Barrier(9, timeout=60), threading.Event()

    def work():
        with cvkern.use("warp"):
            cvkern.canny(noise(500, 800))
            done.wait()
            end.wait(60)

    before = resident()
    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    done.wait()
    held = resident() - before
    cvkern.release_memory()
    assert resident() - before < held / 3
    end.set()
    for thread in threads:
        thread.join()


def test_threads_that_end_leave_nothing():
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: cvkern.canny(noise(*SHAPE)), range(4)))
    gc.collect()
    assert kept() == 0


@pytest.mark.parametrize("most", [0, 1, 3])
def test_no_more_is_kept_than_the_cap(monkeypatch, most):
    image = noise(700, 900)
    want = cvkern.canny(image)
    before = kept()
    assert before > 3 << 20
    monkeypatch.setenv("CVKERN_SCRATCH_MB", str(most))
    cvkern.release_memory()
    for _ in range(2):
        np.testing.assert_array_equal(cvkern.canny(image), want)
        assert kept() <= most << 20
    with ThreadPoolExecutor(3) as pool:
        for got in pool.map(lambda _: cvkern.canny(image), range(9)):
            np.testing.assert_array_equal(got, want)
        assert kept() <= most << 20


@pytest.mark.parametrize("value", ["-1", "much", "1.5"])
def test_the_cap_is_checked(monkeypatch, value):
    monkeypatch.setenv("CVKERN_SCRATCH_MB", value)
    with pytest.raises(ValueError, match=r"^CVKERN_SCRATCH_MB must be an integer >= 0, got '"):
        cvkern.canny(noise(*SHAPE))


def test_calls_at_work_are_not_disturbed():
    """Memory goes while other threads compute in it: a view keeps what it shows."""
    image = noise(500, 600)
    want, stop = cvkern.canny(image), threading.Event()

    def work(_):
        with cvkern.use("warp"):
            return [np.array_equal(cvkern.canny(image), want) for _ in range(15)]

    def release():
        while not stop.is_set():
            cvkern.release_memory()

    releaser = threading.Thread(target=release)
    releaser.start()
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(work, range(3)))
    stop.set()
    releaser.join()
    assert all(map(all, found))


def test_captured_calls_keep_theirs():
    frame = noise(*SHAPE)
    replay = cvkern.capture(cvkern.canny, frame, 1.0, 0.1, 0.2)
    cvkern.release_memory()
    frame[...] = noise(*SHAPE, seed=1)
    np.testing.assert_array_equal(replay(), cvkern.canny(frame, 1.0, 0.1, 0.2))


def test_not_within_a_captured_call():
    def call(image):
        cvkern.release_memory()
        return cvkern.gaussian(image)

    with pytest.raises(ValueError, match=r"^captured functions must be kernels alone, got rele"):
        cvkern.capture(call, noise(9, 9))


def test_results_use_memory_again():
    """Once nothing refers to a result, a later one of its size has its memory, without faults."""
    cvkern.release_memory()
    image = np.random.default_rng(0).random((600, 700), np.float32)
    first = cvkern.gaussian(image, 1.0)
    place, part = first.ctypes.data, first[3:9, 5:].T
    want = part.copy()
    second = cvkern.gaussian(image, 2.0)
    assert second.ctypes.data != place
    del first
    assert cvkern.gaussian(image, 3.0).ctypes.data != place  # a view still refers to it
    np.testing.assert_array_equal(part, want)
    del part
    third = cvkern.gaussian(image, 3.0)
    assert third.ctypes.data == place
    np.testing.assert_array_equal(second, cvkern.gaussian(image, 2.0))


def test_kept_results_are_limited_and_released(monkeypatch):
    cvkern.release_memory()
    monkeypatch.setattr(_memory, "_MOST", 5 << 20)
    images = [np.zeros((512, 512 + 16 * n), np.float32) for n in range(9)]
    for image in images:
        cvkern.box(image)
    sizes = [room for room, free in _memory._free.items() for _ in free]
    assert 3 <= len(sizes) <= 5
    assert sum(sizes) <= 5 << 20
    assert max(sizes) >= images[-1].nbytes  # the last one is kept, the first are not
    cvkern.release_memory()
    assert not _memory._free
