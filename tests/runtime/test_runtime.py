"""The choice of set and device: `use`, environment, threads, forks, and the caller's arrays."""

import gc
import os
import subprocess
import sys
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS, PACKAGES, runtime
from tests.calls import CALLS, blobs, fields, layouts, noise

ROOT = Path(__file__).parents[2]


def chosen():
    rt = runtime()
    return rt.name, rt.device


def run(code, **environment):
    """Run code in a fresh interpreter, warnings being errors; it must end well and say nothing."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith("CVKERN_")}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        env={**clean, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.strip()


# --- use() ---------------------------------------------------------------------------------------


def test_use_as_a_block_restores_what_was():
    before = chosen()
    with cvkern.use(backend="taichi"):
        assert chosen() == ("taichi", "cpu")
        with cvkern.use("warp"), cvkern.use(device="cpu"):
            assert chosen() == ("warp", "cpu")
        assert chosen() == ("taichi", "cpu")
        with pytest.raises(KeyError), cvkern.use(backend="warp"):
            raise KeyError
        assert chosen() == ("taichi", "cpu")
    assert chosen() == before


def test_use_as_a_statement_holds_on():
    with cvkern.use(backend="warp"):
        cvkern.use("taichi")
        assert chosen() == ("taichi", "cpu")
        cvkern.use(device="cpu")
        assert chosen() == ("taichi", "cpu")


def test_a_refused_choice_changes_nothing():
    with cvkern.use(backend="taichi"):
        with pytest.raises(ValueError, match="backend must be"):
            cvkern.use("opencl")
        with pytest.raises(ValueError, match="device must be"):
            cvkern.use("warp", "gpu")
        assert chosen() == ("taichi", "cpu")


def test_threads_choose_for_themselves():
    def choose(name):
        with cvkern.use(backend=name):
            ready.wait()
            return chosen()[0]

    ready = threading.Barrier(2, timeout=60)
    with cvkern.use(backend="taichi"), ThreadPoolExecutor(2) as pool:
        assert list(pool.map(choose, KERNEL_SETS)) == list(KERNEL_SETS)
        assert chosen()[0] == "taichi"


def test_the_environment_sets_the_defaults():
    code = "import cvkern; from cvkern._runtime import runtime; print(runtime().name)"
    assert run(code) == "warp"
    assert run(code, CVKERN_BACKEND="taichi") == "taichi"
    assert run(code, CVKERN_BACKEND="", CVKERN_DEVICE="") == "warp"
    late = f"{code}; import os; os.environ['CVKERN_BACKEND'] = 'taichi'; print(runtime().name)"
    assert run(late) == "warp\nwarp"
    code = f"import cvkern\ncvkern.use('warp')\n{code}"
    assert run(code, CVKERN_BACKEND="taichi") == "warp"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("CVKERN_BACKEND", "cuda", "backend must be one of ('warp', 'taichi'), got 'cuda'"),
        ("CVKERN_DEVICE", "gpu", f"device must be {cvkern._runtime.DEVICES}, got 'gpu'"),
        ("CVKERN_NUM_THREADS", "0", "CVKERN_NUM_THREADS must be an integer >= 1, got '0'"),
        ("CVKERN_NUM_THREADS", "-2", "CVKERN_NUM_THREADS must be an integer >= 1, got '-2'"),
        ("CVKERN_NUM_THREADS", "two", "CVKERN_NUM_THREADS must be an integer >= 1, got 'two'"),
    ],
)
def test_the_environment_is_checked(name, value, message):
    code = (
        "import cvkern\n"
        "try:\n    cvkern.gaussian([[1.0, 2.0]])\n"
        "except ValueError as error:\n    print(error)"
    )
    assert run(code, **{name: value}) == message


def test_a_device_that_is_not_there(backend):
    before = chosen()
    message = rf"^device must be one that {backend} finds here, \('cpu'.*\), got 'cuda:99'$"
    for _ in range(2):
        with pytest.raises(ValueError, match=message):
            cvkern.use(device="cuda:99")
        assert chosen() == before
    np.testing.assert_allclose(cvkern.gaussian(np.ones((3, 4))), 1, rtol=1e-6)


def test_devices(backend):
    found = cvkern.devices()
    assert found[0] == "cpu"
    assert found == cvkern.devices(backend)
    for device in found:
        with cvkern.use(device=device):
            assert chosen() == (backend, device)
    known = {*cvkern.devices("warp"), "vulkan", "metal"}
    assert set(cvkern.devices("taichi")) <= known
    with pytest.raises(ValueError, match="backend must be one of"):
        cvkern.devices("opencl")


def test_a_default_that_is_not_there():
    code = (
        "import cvkern\n"
        "try:\n    cvkern.gaussian([[1.0, 2.0]])\n"
        "except ValueError as error:\n    print(error)"
    )
    said = run(code, CVKERN_DEVICE="cuda:99")
    assert said.startswith("device must be one that warp finds here, ('cpu'")


@pytest.mark.parametrize(("gone", "other"), [("taichi", "warp"), ("warp", "taichi")])
def test_one_kernel_set_works_without_the_other(gone, other):
    """Taichi has no wheels for the newest Python: Warp works alone then, and says so."""
    code = f"""
import sys
sys.modules[{gone!r}] = None  # an import of it fails from here on
import numpy as np
import cvkern
for ask in (lambda: cvkern.use({gone!r}), lambda: cvkern.devices({gone!r})):
    try:
        ask()
    except ImportError as error:
        print(error)
with cvkern.use({other!r}):
    print(cvkern.devices()[0], cvkern.canny(np.eye(9)).shape)
"""
    said = (
        f"the {gone!r} backend needs {PACKAGES[gone][1]}, which is not installed "
        f"(it has no wheels for every Python): use {other!r}"
    )
    assert run(code).splitlines() == [said, said, "cpu (9, 9)"]


# --- the caller's arrays -------------------------------------------------------------------------


def give(library, image):
    """Make an array of `library`, and a function that brings one to NumPy."""
    module = pytest.importorskip(library)
    if library == "torch":
        return module.from_numpy(image.copy())
    if library == "jax":
        return module.device_put(image, module.devices("cpu")[0])
    return module.array(image, device="cpu")


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("library", ["torch", "jax", "warp"])
@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_the_same_library_comes_back(backend, dtype, library, name):
    image = blobs(21, 34).astype(dtype)
    given = give(library, image)
    got, want = CALLS[name](given), CALLS[name](image)
    assert type(got) is (type(want) if isinstance(want, tuple) else type(given))
    for a, b in zip(fields(got), fields(want), strict=True):
        assert type(a) is type(given)
        host = np.asarray(a) if library != "warp" else a.numpy()
        assert host.dtype == b.dtype
        np.testing.assert_array_equal(host, b)
    np.testing.assert_array_equal(given.numpy() if library == "warp" else np.asarray(given), image)


@pytest.mark.parametrize("library", ["torch", "warp"])
def test_strided_arrays_of_other_libraries(backend, library):
    image = noise(24, 33)
    if library == "torch":
        strided, image = give(library, image)[::2, 1::3], image[::2, 1::3]
    else:
        strided = give(library, image.T.copy()).transpose()
    for name in ("gaussian", "median", "canny"):
        got, want = CALLS[name](strided), CALLS[name](image)
        np.testing.assert_array_equal(got.numpy(), want)


@pytest.mark.parametrize("dtype", ["float64", "int16", "float16", "bool", "int64"])
def test_other_dtypes_of_torch(backend, dtype):
    image = noise(12, 15, dtype=dtype)
    given = give("torch", image)
    for name in ("gaussian", "median"):
        np.testing.assert_array_equal(CALLS[name](given).numpy(), CALLS[name](image))


def test_tensors_that_are_negative_by_a_mark(backend):
    """Of the imaginary part of a conjugate, torch keeps the numbers of the original."""
    image = noise(12, 15)
    part = (1j * give("torch", image)).conj().imag
    assert part.is_neg()
    np.testing.assert_array_equal(CALLS["gaussian"](part).numpy(), CALLS["gaussian"](-image))


def test_out_of_torch(backend):
    torch = pytest.importorskip("torch")
    image, out = give("torch", noise(9, 12)), torch.full((9, 12), torch.nan)
    assert cvkern.gaussian(image, 1.5, out=out) is out
    np.testing.assert_array_equal(out.numpy(), CALLS["gaussian"](image.numpy()))


@pytest.mark.filterwarnings("ignore:no edge was found")
@pytest.mark.parametrize("name", CALLS)
def test_inputs_are_never_written(backend, name, tmp_path):
    for dtype in ("uint8", "float32", "float64", "bool"):
        image = blobs(20, 33).astype(dtype)
        for layout, laid_out in layouts(image, tmp_path):
            CALLS[name](laid_out)
            np.testing.assert_array_equal(laid_out, image, err_msg=f"{layout} {dtype}")
    taps = np.array([1.0, 2.0, 1.0], np.float32)
    cvkern.correlate_separable(image, taps)
    np.testing.assert_array_equal(taps, [1, 2, 1])


@pytest.mark.parametrize("name", CALLS)
def test_results_are_the_callers_own(backend, name):
    """A later call, or a write into a result, must not change another result."""
    image = blobs(20, 33)
    first = fields(CALLS[name](image))
    copies = [a.copy() for a in first]
    second = fields(CALLS[name](255 - image))
    for a, b, c in zip(first, second, copies, strict=True):
        assert a.flags.writeable
        assert a.flags.c_contiguous
        assert not np.shares_memory(a, b)
        assert not np.shares_memory(a, image)
        np.testing.assert_array_equal(a, c)
        a[...] = 0
    for a, c in zip(fields(CALLS[name](image)), copies, strict=True):
        np.testing.assert_array_equal(a, c)


def test_calls_keep_no_array_alive(backend):
    image = blobs(20, 33)
    for call in CALLS.values():
        call(image)
    gone = weakref.ref(image)
    del image
    gc.collect()
    assert gone() is None


# --- threads and forks ---------------------------------------------------------------------------


def test_eight_threads_with_images_of_their_own(backend):
    """Small ones, and some that each thread would cut into slabs for others."""
    sizes = [(9 + 31 * i, 400 - 45 * i) for i in range(7)] + [(300, 450)]
    images = [blobs(*size, seed=i) for i, size in enumerate(sizes)]
    names = ["gaussian", "gradient", "canny", "canny_sectors", "subpixel_edges", "median"]
    expected = [[fields(CALLS[name](image)) for name in names] for image in images]
    ready = threading.Barrier(len(images), timeout=60)

    def work(index):
        ready.wait()
        with cvkern.use(backend=backend):
            for _ in range(3):
                for name, want in zip(names, expected[index], strict=True):
                    for a, b in zip(fields(CALLS[name](images[index])), want, strict=True):
                        np.testing.assert_array_equal(a, b, err_msg=name)
        return index

    with ThreadPoolExecutor(len(images)) as pool:
        assert list(pool.map(work, range(len(images)))) == list(range(len(images)))


def test_first_calls_from_many_threads():
    """Initialising, compiling and loading at once, in a process that has done none of it."""
    code = """
import sys, threading
import numpy as np
import cvkern
image = np.random.default_rng(0).integers(0, 256, (40, 50)).astype(np.uint8)
ready, found = threading.Barrier(8), []
def work(backend):
    ready.wait()
    with cvkern.use(backend=backend):
        found.append(cvkern.canny(image, 1.0).tobytes() + cvkern.gaussian(image).tobytes())
names = ["warp", "taichi"] * 4
threads = [threading.Thread(target=work, args=(name,)) for name in names]
for thread in threads: thread.start()
for thread in threads: thread.join()
print(len(found), len(set(found)))
"""
    assert run(code) == "8 1"


THREADS = """
import zlib
import numpy as np
import cvkern
image = np.random.default_rng(0).integers(0, 256, (411, 523)).astype(np.uint8)
answers = [cvkern.gaussian(image, 2.0), *cvkern.gradient(image), cvkern.median(image, 1),
    cvkern.canny(image, 1.0, 40, 160), cvkern.canny(image, 0, 300, 900, suppression="sectors"),
    cvkern.canny(image, 1.5, 0.7, 0.9, use_quantiles=True)]
print([zlib.crc32(a.tobytes()) for a in answers])
"""


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_the_number_of_threads_changes_no_bit(name):
    """In fresh processes, whose threads all come to load the same modules first."""
    alone, *others = (
        run(THREADS, CVKERN_BACKEND=name, CVKERN_NUM_THREADS=count) for count in ("1", "3", "5")
    )
    assert "[" in alone
    assert others == [alone, alone]


FORK = """
import os, sys
import numpy as np
import cvkern
image = np.random.default_rng(0).random((400, 600), np.float32)
before = cvkern.gaussian(image, 1.5)  # starts the threads
child = os.fork()
if child == 0:
    try:
        same = np.array_equal(cvkern.gaussian(image, 1.5), before)
        cvkern.canny(image)
        code = 10 if same else 1
    except RuntimeError as error:
        code = 20 if "start workers with the 'spawn' method" in str(error) else 2
    os._exit(code)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
assert np.array_equal(cvkern.gaussian(image, 1.5), before)  # the parent goes on
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
@pytest.mark.parametrize(("name", "outcome"), [("warp", "10"), ("taichi", "20")])
def test_a_forked_child_works_or_says_why_not(name, outcome):
    # Python 3.12 and later warn of any fork beside threads: the warning is not ours to silence.
    code = f"import warnings\nwarnings.simplefilter('ignore', DeprecationWarning)\n{FORK}"
    assert run(code, CVKERN_BACKEND=name, CVKERN_NUM_THREADS="3") == outcome


def test_spawned_workers_work(backend, tmp_path):
    script = tmp_path / "workers.py"
    script.write_text(
        "import multiprocessing, numpy as np, cvkern\n"
        "def work(seed):\n"
        "    image = np.random.default_rng(seed).random((30, 40), np.float32)\n"
        "    return float(cvkern.gaussian(image, 1.0).sum())\n"
        "if __name__ == '__main__':\n"
        "    with multiprocessing.get_context('spawn').Pool(2) as pool:\n"
        "        assert pool.map(work, range(3)) == [work(i) for i in range(3)]\n"
        "    print('equal')\n"
    )
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    code = f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')"
    assert run(code, CVKERN_BACKEND=backend, PYTHONPATH=path) == "equal"


@pytest.mark.parametrize("name", ["gaussian", "box", "median"])
def test_out_of_warp_is_filled(name):
    wp = pytest.importorskip("warp")
    image = noise(9, 14)
    out = wp.full((9, 14), 7.0, dtype=wp.float32, device="cpu")
    function = getattr(cvkern, name)
    assert function(wp.array(image, device="cpu"), 1, out=out) is out
    np.testing.assert_array_equal(out.numpy(), function(image, 1))
