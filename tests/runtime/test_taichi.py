"""Properties of the Taichi kernel set in a process: threads, forks, other code, NumPy."""

import ast
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cvkern.kernels.taichi as kernels
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.taichi._denormals import can_keep_denormals
from cvkern.kernels.taichi.filters import linear
from tests.filters import reference_linear as reference

F32 = np.float32
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _started():
    kernels.start("cpu")


def blur(src, taps):
    dst = np.empty_like(src)
    linear.correlate_separable(src, taps, taps, 1, Border.REFLECT, 0.0, dst)
    return dst


def run(code, **environment):
    """Run code in a fresh interpreter with warnings as errors; return (exit code, out, err)."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )
    return done.returncode, done.stdout, done.stderr


def test_four_threads_at_once():
    wrong, ready = [], threading.Barrier(4)

    def work(seed):
        rng = np.random.default_rng(seed)
        ready.wait()
        for i in range(50):
            src = rng.random((1, 5 + 7 * seed + i, 60 - i), F32)
            taps = rng.random(3 + 2 * (i % 4), F32)
            want = reference.correlate_separable(src, taps, taps, 1, Border.REFLECT, 0.0)
            if not np.array_equal(blur(src, taps), want):
                wrong.append((seed, i))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_first_launch_on_another_thread_than_start():
    code = """
import threading, numpy as np, cvkern.kernels.taichi as kernels
from cvkern.kernels.taichi._denormals import can_keep_denormals
from cvkern.kernels.taichi.filters import linear as filters
starter = threading.Thread(target=kernels.start, args=("cpu",))
starter.start(); starter.join()
src = np.ones((1, 5, 6), np.float32); taps = np.ones(3, np.float32); dst = np.empty_like(src)
given = src, taps, taps, 1, 0, 0.0, dst
worker = threading.Thread(target=filters.correlate_separable, args=given)
worker.start(); worker.join()
assert (dst == 9).all()
"""
    assert run(code) == (0, "", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_a_forked_child_is_told_so():
    code = """
import os, numpy as np, cvkern.kernels.taichi as kernels
from cvkern.kernels.taichi.filters import gradients
kernels.start("cpu")
if os.fork() == 0:
    a = np.zeros((1, 1), np.float32)
    said = 0
    for call in (lambda: gradients.root_mean_square(a, a, a), lambda: kernels.start("cpu")):
        try:
            call()
        except RuntimeError as error:
            said += "start workers with the 'spawn' method" in str(error)
    os._exit(said)
assert os.waitstatus_to_exitcode(os.wait()[1]) == 2
"""
    assert run(code) == (0, "", "")


def test_a_fork_before_the_start_works():
    code = """
import os, numpy as np, cvkern.kernels.taichi as kernels
from cvkern.kernels.taichi.filters import gradients
if os.fork() == 0:
    kernels.start("cpu")
    a, b = np.ones((2, 1, 1), np.float32)
    gradients.root_mean_square(a, a, b)
    os._exit(int(b[0, 0] == 1))
assert os.waitstatus_to_exitcode(os.wait()[1]) == 1
"""
    assert run(code) == (0, "", "")


def test_it_says_nothing_and_asks_no_server():
    code = """
import socket
def refuse(*a, **k): raise AssertionError("network")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
import cvkern.kernels.taichi as kernels
kernels.start("cpu")
"""
    assert run(code, TI_ARCH="vulkan") == (0, "", "")


def test_denormal_numbers_outside_kernels_stay():
    code = """
import numpy as np, cvkern.kernels.taichi as kernels
from cvkern.kernels.taichi.filters import gradients
kernels.start("cpu")
a = np.ones((1, 1), np.float32)
gradients.root_mean_square(a, a, a.copy())
assert np.sqrt(np.full(9, 1e-45, np.float32)).all()
"""
    assert run(code) == (0, "", "")


@pytest.mark.skipif(not can_keep_denormals(), reason="known to work only with glibc on x86-64")
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_denormal_numbers_stay_in_kernels(threads):
    code = """
import numpy as np, cvkern.kernels.taichi as kernels
from cvkern.kernels.taichi.filters import gradients
kernels.start("cpu")
a = np.full(2**16, 1e-39, np.float32)
for _ in range(20):
    out = np.zeros_like(a)
    gradients.add(a, a, out)
    assert np.array_equal(out, a + a)
"""
    assert run(code, CVKERN_NUM_THREADS=str(threads)) == (0, "", "")


def test_other_code_keeps_its_taichi():
    code = """
import cvkern.kernels.taichi as kernels, taichi as ti, numpy as np, contextlib, io
from cvkern.kernels.taichi.filters import gradients
def init():
    with contextlib.redirect_stdout(io.StringIO()):
        ti.init(arch=ti.cpu, log_level=ti.ERROR)
def refused(call):
    try:
        call()
    except RuntimeError as error:
        assert "in use by other code" in str(error)
        return True
a = np.ones((1, 1), np.float32)
init()
field = ti.field(ti.f32, 3)
field.fill(7)
assert refused(lambda: kernels.start("cpu"))
assert field[1] == 7
ti.reset()
kernels.start("cpu")
gradients.root_mean_square(a, a, a.copy())
init()
assert refused(lambda: gradients.root_mean_square(a, a, a.copy()))
ti.reset()
gradients.root_mean_square(a, a, a.copy())
"""
    assert run(code) == (0, "", "")


@pytest.mark.parametrize("device", ["gpu", "cuda:1", "", "cuda:99"])
def test_start_rejects_a_device_that_is_not_there(device):
    with pytest.raises(
        ValueError, match=rf"must be one that taichi finds here, .*, got '{device}'"
    ):
        kernels.start(device)
    blur(np.ones((1, 3, 3), F32), np.ones(3, F32))  # the old one still runs


def test_the_number_of_threads_is_the_callers():
    code = """
import os, cvkern.kernels.taichi as kernels, taichi as ti
kernels.start("cpu")
print(ti.cfg.cpu_max_num_threads, ti.cfg.fast_math)
"""
    assert run(code, CVKERN_NUM_THREADS="3") == (0, "3 False\n", "")


def test_adopt_reads_in_place():
    image = np.random.default_rng(0).random((4, 5), F32)
    image.flags.writeable = False
    assert np.shares_memory(kernels.adopt(image, image.dtype, (5, 4), "cpu"), image)
    mask = image > 0.5
    carried = kernels.adopt(mask, mask.dtype, mask.shape, "cpu")
    assert carried.dtype == np.uint8
    assert np.shares_memory(carried, mask)


def test_inputs_are_not_written():
    src = np.random.default_rng(0).random((1, 9, 9), F32)
    src.flags.writeable = False
    before = src.copy()
    blur(src, np.ones(5, F32))
    np.testing.assert_array_equal(src, before)


def test_kernels_take_the_memory_of_device_arrays():
    """What carries arrays on CUDA, checked on memory of the host."""
    wp = pytest.importorskip("warp")
    from cvkern.kernels.taichi import _cuda

    src = np.random.default_rng(0).random((1, 8, 9), F32)
    taps = np.array([1, 2, 1], F32)
    dst = wp.zeros(src.shape, dtype=wp.float32, device="cpu")
    views = [_cuda.view(a.ctypes.data, a, a.dtype, a.shape, "cpu") for a in (src, taps)]
    given = [_cuda.header(view) for view in views]
    header = _cuda.header(dst)
    assert given[0].ctypes.data == src.ctypes.data
    assert header.ctypes.data == dst.ptr
    linear.correlate_separable(given[0], given[1], given[1], 1, Border.REFLECT, 0.0, header)
    np.testing.assert_array_equal(dst.numpy(), blur(src, taps))
    assert _cuda.header(wp.zeros((0, 3), dtype=wp.int32, device="cpu")).shape == (0, 3)
    begin = np.int64(4)  # it makes the address of a slice NumPy's as well
    part = wp.zeros(9, dtype=wp.int32, device="cpu")[begin:]
    assert _cuda.header(part).ctypes.data == part.ptr
    mask = wp.zeros(3, dtype=wp.bool, device="cpu")
    seen = _cuda.view(mask.ptr, mask, np.dtype(np.bool_), (3,), "cpu")
    assert seen.dtype is wp.uint8
    assert seen.ptr is not None
    assert _cuda.view(seen.ptr, seen, np.dtype(np.uint8), (3,), "cpu") is seen


def test_sources_are_read_once_and_ours_are_not_drawn():
    """Taichi draws each node of a kernel for messages; the code of others keeps these."""
    from taichi.lang import kernel_impl
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    node = ast.parse("a = b").body[0]
    for folder, drawn in ((ROOT / "tests", True), (Path(kernels.__file__).parent, False)):
        made: Any = SimpleNamespace(
            file=str(folder / "x.py"), lineno_offset=6, func=SimpleNamespace(func=blur),
            src=["a = b"], indent=0,
        )  # fmt: skip
        said = ASTTransformerContext.get_pos_info(made, node)
        assert said.startswith(f'File "{folder}/x.py", line 7, in blur:\n')
        assert ("^^^^^" in said) == drawn
    assert kernel_impl.getsourcelines(blur) is kernel_impl.getsourcelines(blur)


def test_kernels_in_classes_of_others():
    """Ours are in no class, so that Taichi does not look for one; it still finds others."""
    import taichi as ti

    @ti.data_oriented
    class Double:
        @ti.kernel
        def of(self, x: ti.i32) -> ti.i32:  # pyright: ignore[reportInvalidTypeForm]
            return 2 * x

    assert Double().of(21) == 42
