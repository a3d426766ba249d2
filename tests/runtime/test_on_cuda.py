"""The runtime on a GPU: freed memory, arrays on two devices, Warp's plain ways."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern.kernels.warp import _pages, _scratch
from tests.on_cuda import LIBRARIES, assert_equal_bits, give, noise, on_gpu, reference, take

pytestmark = pytest.mark.usefixtures("gpu")

ROOT = Path(__file__).parents[2]


def kept():
    with _scratch._lock:
        threads = list(_scratch._threads.values())
    return [block for blocks in threads for block in list(blocks.values())]


def test_devices(backend):
    assert cvkern.devices()[:2] == ("cpu", "cuda:0")
    with cvkern.use(device="cuda"):
        assert cvkern.gaussian(noise()).shape == noise().shape


def test_memory_is_given_back():
    image = noise((1080, 1920))
    want = reference(cvkern.canny, image)
    on_gpu(cvkern.canny, image, "warp")
    assert any(not block.bytes_on_host for block in kept())
    cvkern.release_memory()
    assert kept() == []
    assert not any(_pages._free.values())
    assert_equal_bits(on_gpu(cvkern.canny, image, "warp"), want)


def test_other_threads_give_theirs_back_with_the_next_call():
    image = noise((500, 700))
    want = reference(cvkern.canny, image)
    with ThreadPoolExecutor(1) as pool:
        for _ in range(2):
            got = pool.submit(on_gpu, cvkern.canny, image, "warp").result()
            assert_equal_bits(got, want)
            ages = {block.age for block in kept() if not block.bytes_on_host}
            assert ages == {_scratch._age}
            cvkern.release_memory()


def test_recorded_calls_keep_theirs():
    frame = give("warp", noise())
    replay = cvkern.capture(cvkern.canny, frame, 1.0, 0.1, 0.2)
    cvkern.release_memory()
    wp.copy(frame, wp.array(noise(seed=1), device="cpu"))
    want = reference(lambda x: cvkern.canny(x, 1.0, 0.1, 0.2), noise(seed=1))
    assert_equal_bits(take(replay()), want)


@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_of_two_places_are_refused(library):
    left, right = give(library, noise()), give(library, noise())
    if library == "torch":
        right = right.cpu()
    elif library == "warp":
        right = right.to("cpu")
    else:
        pytest.skip("needs a library whose arrays are on the CPU as well")
    with pytest.raises(ValueError, match=r"^arrays must be on one device, got cpu, cuda:0$"):
        cvkern.left_right_check(left, right)


def test_a_newer_warp_works_by_the_plain_ways():
    code = """
import warp
warp.__version__ = "99.0.0"
import cvkern
from cvkern.kernels.warp import _internals
from tests.on_cuda import assert_equal_bits, noise, on_gpu, reference
assert not _internals.QUICK
calls = cvkern.gaussian, cvkern.canny, cvkern.sobel, lambda x: cvkern.hough_line(x > 0.7).votes
for call in calls:
    for _ in range(2):
        assert_equal_bits(on_gpu(call, noise(), "warp"), reference(call, noise()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr


def test_big_endian_images_go_to_the_gpu(backend):
    image = noise()
    want = reference(cvkern.gaussian, image)
    assert_equal_bits(on_gpu(cvkern.gaussian, image.astype(">f4"), backend), want)
    assert isinstance(want, np.ndarray)
