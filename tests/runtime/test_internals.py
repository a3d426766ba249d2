"""The quick and the plain ways into Warp agree; a newer Warp gets the plain ones."""

# The kernel is in Warp's language, which no Python type checker reads.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportAttributeAccessIssue=false, reportAssignmentType=false

import json
import os
import subprocess
import sys
import threading
import weakref
import zlib
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern.kernels.warp import _compiling, _internals, _scratch
from tests.calls import CALLS, blobs, fields

ROOT = Path(__file__).parents[2]

PLAIN = """
import json, sys, warp
warp.__version__ = sys.argv[1]
from cvkern.kernels.warp import _internals
from tests.runtime.test_internals import checksums
print(json.dumps([_internals.QUICK, checksums()]))
"""


def checksums():
    """Return a number for the answer of each function, in two sizes, the second twice."""
    found = {}
    with cvkern.use("warp"):
        for name, call in CALLS.items():
            answers = [call(blobs(*size)) for size in ((24, 40), (31, 33), (31, 33))]
            bits = b"".join(np.asarray(a).tobytes() for answer in answers for a in fields(answer))
            found[name] = zlib.crc32(bits)
    return found


def with_version(version):
    done = subprocess.run(
        [sys.executable, "-c", PLAIN, version],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_newer_warp_gets_the_same_answers_by_the_plain_ways():
    quick, found = with_version("99.0.0")
    assert quick is False
    assert found == checksums()


@pytest.mark.parametrize(
    ("version", "quick"),
    [("1.18.3", True), ("1.19.7", True), ("1.20.0rc1", False), ("2.0", False), ("a word", False)],
)
def test_the_version_decides(monkeypatch, version, quick):
    monkeypatch.setattr(wp, "__version__", version)
    assert _internals._quick() is quick


def test_this_warp_is_one_that_was_tested():
    """When this fails, try the quick ways with the new Warp, then raise TESTED."""
    assert _internals.QUICK


@pytest.mark.parametrize(
    ("shape", "strides"), [((3, 4), None), ((2, 2, 3), None), ((0, 4), None), ((2, 2), (32, 8))]
)
def test_views_agree(shape, strides):
    wp.init()
    memory = np.arange(12, dtype=np.float32)
    device = wp.get_device("cpu")
    given = memory.ctypes.data, wp.float32, shape, device, strides
    quick = _internals._quick_view_at(*given)
    plain = _internals._plain_view_at(*given)
    for name in ("ptr", "shape", "strides", "size", "capacity", "ndim", "dtype", "device",
                 "is_contiguous"):  # fmt: skip
        if quick.size or name != "ptr":
            assert getattr(quick, name) == getattr(plain, name), name
    np.testing.assert_array_equal(quick.numpy(), plain.numpy())
    assert bytes(quick.__ctype__())[8:] == bytes(plain.__ctype__())[8:]


@wp.struct
class Factor:
    value: wp.float32


@wp.kernel
def scale(factor: Factor, plus: int, source: wp.array2d[float], out: wp.array2d[float]):
    i, j = wp.tid()
    if source:
        out[i, j] = factor.value * source[i, j] + float(plus)
    else:
        out[i, j] = float(plus)


def test_commands_agree():
    """The same launches again with other numbers, structures, arrays, layouts and sizes."""
    wp.init()
    device = wp.get_device("cpu")
    _compiling.load(scale, device, 1)
    rng = np.random.default_rng(0)
    made = {}
    for shape in ((3, 4), (3, 4), (2, 6), (5, 7), (3, 4)):
        factor = Factor()
        factor.value = float(rng.integers(1, 9))
        plus, image = int(rng.integers(9)), rng.random(shape).astype(np.float32)
        results = []
        for kind in (_internals._QuickCommand, _internals._PlainCommand):
            out = wp.zeros(shape, dtype=float, device="cpu")
            arguments = factor, plus, wp.array(image, dtype=float, device="cpu"), out
            if kind not in made:
                made[kind] = kind(scale, shape, arguments, device, 1)
            made[kind].launch(shape, arguments, None)
            results.append(out.numpy())
        np.testing.assert_array_equal(*results)
        # One rounding of the product and one of the sum, or one of both.
        np.testing.assert_allclose(results[0], factor.value * image + plus, rtol=2**-22)


THREADS = """
import threading
import numpy as np
import cvkern
from cvkern.kernels.warp import _compiling
load, names = _compiling._load, set()
def watched(*arguments):
    names.add(threading.current_thread().name.rpartition("_")[0])
    load(*arguments)
_compiling._load = watched
image = np.random.default_rng(0).random((700, 900), np.float32)
cvkern.canny(image)
cvkern.median(image > 0.5)
workers = [threading.Thread(target=cvkern.sobel, args=(image,)) for _ in range(2)]
for worker in workers: worker.start()
for worker in workers: worker.join()
print(*names)
"""


def test_threads_of_their_own_compile():
    """Whoever asks."""
    done = subprocess.run(
        [sys.executable, "-c", THREADS],
        cwd=ROOT,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path]),
            "CVKERN_NUM_THREADS": "3",
        },
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.stdout == "cvkern-compiler\n", done.stderr


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_work_is_shared_by_the_threads_that_the_user_wants(monkeypatch, threads):
    """Each thread takes a part of a kernel's rows; without the variable, one for each core."""
    from cvkern.kernels.warp import _launch

    sent, send = [], _launch._send

    def noted(*arguments):
        sent.append(threading.current_thread().name)
        send(*arguments)

    monkeypatch.setattr(_launch, "_send", noted)
    monkeypatch.setenv("CVKERN_NUM_THREADS", str(threads))
    image = np.zeros((640, 640), np.float32)
    with cvkern.use(backend="warp", device="cpu"):
        cvkern.box(image, 3)
    assert len(sent) % threads == 0
    assert len(set(sent)) <= threads
    whole = len(sent) // threads
    monkeypatch.setenv("CVKERN_NUM_THREADS", "1")
    sent.clear()
    with cvkern.use(backend="warp", device="cpu"):
        cvkern.box(image, 3)
    assert len(sent) == whole


def test_a_view_keeps_the_memory_that_its_array_owns():
    array = wp.zeros(8, dtype=wp.uint8, device="cpu")
    there = weakref.ref(array)
    seen = _scratch.view(array, wp.uint64, (1,))
    assert seen.ptr == array.ptr
    del array
    assert there() is not None
    del seen
    assert there() is None  # without waiting for a collection of cycles
