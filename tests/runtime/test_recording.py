"""Graphs are recorded only while one thread uses CUDA."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import skimage.data

import cvkern
from cvkern.kernels.warp import _replays


def test_a_thread_is_alone_until_another_one_begins():
    begun, end = threading.Event(), threading.Event()

    def other():
        _replays.announce()
        begun.set()
        end.wait(20)

    thread = threading.Thread(target=other)
    _replays.announce()
    with _replays.alone() as alone:
        assert alone
        thread.start()
        assert not begun.wait(0.2)  # it waits until the recording ends
    assert begun.wait(20)
    with _replays.alone() as alone:
        assert not alone
    end.set()
    thread.join()
    with _replays.alone() as alone:
        assert alone


def test_threads_on_cuda(gpu):
    image = skimage.data.astronaut()
    with cvkern.use(device="cuda"):
        want = cvkern.canny(image, 2), cvkern.sift(image).points

    def work(_):
        with cvkern.use(device="cuda"):
            return cvkern.canny(image, 2), cvkern.sift(image).points

    with ThreadPoolExecutor(8) as pool:
        for found in pool.map(work, range(64)):
            assert all(np.array_equal(a, b) for a, b in zip(found, want, strict=True))
