"""Fixtures shared by all tests: the kernel sets, and property tests with fixed examples."""

import inspect
import os
import re
import signal
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.calls import is_fact, primitives
from tests.primitives import Primitives
from tests.refusals import EVERY, FLAT

# JAX looks for a GPU on import otherwise, and takes most of its memory.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

# Shells start commands in the background with Ctrl-C ignored; tests of it need it.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile(
    "cvkern",
    derandomize=True,
    database=None,
    deadline=None,  # the first example compiles kernels
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
settings.load_profile("cvkern")


def pytest_addoption(parser):
    parser.addoption(
        "--arrays",
        action="store_true",
        help="run only the tests that name PyTorch or JAX",
    )


OTHERS = re.compile("torch|jax")
PAGES = {"test_readme.py", "test_coming_from.py"}  # examples for users of any library


def pytest_ignore_collect(collection_path, config):
    """Leave out at once, with ``--arrays``, each file that has no such test."""
    name = collection_path.name
    if not config.getoption("--arrays") or not name.startswith("test_") or name in PAGES:
        return None
    text = collection_path.read_text(encoding="utf-8")
    return None if OTHERS.search(text) or "LIBRARIES" in text else True


# Seconds of the files that take longest, of 1200 in all. Files go to the next free process: the
# longest first, or one process would still have a long one when the others are done.
SECONDS = {
    "docs/test_docstrings.py": 80,
    "test_cuda_source.py": 60,
    "app/test_tour.py": 55,
    "radiance/training/test_training.py": 45,
    "app/test_doctor.py": 45,  # 100 if nothing is compiled yet
    "runtime/test_runtime.py": 40,
    "scale/test_panoramas.py": 35,
    "radiance/fields/test_perceptron.py": 30,
    "radiance/test_checkpoints.py": 25,
    "radiance/test_cuda_source.py": 25,
    "recognition/test_models.py": 20,
    "app/test_tour_radiance.py": 20,
    "runtime/test_cache.py": 18,
    "runtime/test_compiling.py": 14,
    "radiance/training/test_settings.py": 15,
    "test_house.py": 12,
    "radiance/training/test_deterministic.py": 10,
    "fuzz/test_fuzz.py": 8,
    "hough/lines/test_votes.py": 8,
    "geometry/test_solvers.py": 8,
}


def pytest_configure(config):
    """Tell pytest-xdist to keep the order below; it would sort files by their number of tests."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(config, items):
    number, here = Counter(item.path for item in items), Path(__file__).parent

    def order(item):
        seconds = SECONDS.get(os.path.relpath(item.path, here), 0)
        return -seconds, -number[item.path], str(item.path)

    items.sort(key=order)
    if config.getoption("--arrays"):
        items[:] = [
            item
            for item in items
            if item.path.name in PAGES
            or OTHERS.search(item.name + inspect.getsource(item.function))
        ]


@pytest.fixture(params=KERNEL_SETS)
def backend(request):
    """Run the test once per kernel set that is installed."""
    pytest.importorskip(request.param)
    with cvkern.use(backend=request.param):
        yield request.param


@pytest.fixture
def gpu():
    """Skip where there is none. NumPy work stays on the CPU."""
    import warp

    warp.init()
    if warp.get_cuda_device_count() == 0:
        pytest.skip("needs a CUDA device")
    with cvkern.use(device="cpu"):
        yield


@pytest.fixture(params=["cpu", "cuda:0"], scope="module")
def device(request):
    return request.param


@pytest.fixture(params=KERNEL_SETS, scope="module")
def kernels(request, device):
    return Primitives(request.param, device)


@pytest.fixture
def half(kernels):
    """Return the precision of products of matrices: half with Warp on CUDA."""
    return np.float16 if (kernels.name, kernels.device) == ("warp", "cuda:0") else np.float32


@pytest.fixture(scope="module")
def all_kernels(device):
    return [Primitives(name, device) for name in KERNEL_SETS]


@pytest.fixture
def no_kernel_runs(monkeypatch):
    """Checks are written once, above the kernel sets: one set shows that they come first."""

    def launched(*args, **options):
        raise AssertionError("a kernel was launched")

    # Import all modules first: a later one would keep what stands in for another's function.
    for module, name, function in list(primitives("warp")):
        if is_fact(function):
            continue
        monkeypatch.setattr(module, name, launched)
    with cvkern.use(backend="warp", device="cpu"):
        for name in EVERY:
            with pytest.raises(AssertionError, match="a kernel was launched"):
                EVERY[name](FLAT)  # otherwise the tests below would show nothing
        yield
