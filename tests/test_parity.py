"""The kernel sets have the same modules, and the modules the same primitives."""

import importlib
import inspect
import pkgutil
from pathlib import Path

import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.calls import primitives
from tests.kernel_stub import STUB, stub

API = Path(cvkern.__file__).parent
ROOT = Path(__file__).parents[1]
UNTIMED = {"clouds"}  # pictures of results, which nobody waits for


def place(module):
    """Return where a kernel module is in its set: "stereo.winners"."""
    return module.__name__.split(".", 3)[3]


def signatures(kernel_set):
    return {
        f"{place(module)}.{name}": list(inspect.signature(function).parameters)
        for module, name, function in primitives(kernel_set)
    }


@pytest.mark.parametrize("other", KERNEL_SETS[1:])
def test_sets_have_the_same_primitives_and_parameters(other):
    assert signatures(other) == signatures(KERNEL_SETS[0])


def test_kernels_are_where_the_api_is():
    """stereo/costs/census.py belongs to stereo/costs.py of the API, or to one of its own path."""
    astray = []
    for module in sorted({place(module) for module, _, _ in primitives("warp")}):
        *folders, last = module.split(".")
        paths = [Path(*folders, f"{mark}{last}.py") for mark in ("", "_")]
        paths += [Path(*folders[:n]).with_suffix(".py") for n in range(1, len(folders) + 1)]
        if not any((API / path).is_file() for path in paths):
            astray.append(module)
    assert astray == []


@pytest.mark.parametrize("module", sorted({place(m) for m, _, _ in primitives("warp")}))
def test_every_family_is_complete(module):
    """Whatever is missing for a kernel module is named here."""
    family = module.partition(".")[0]
    wanted = [f"cvkern/{family}/_warmup.py", f"kernels/codes/{family}.py", f"tests/{family}"]
    if family not in UNTIMED:
        wanted.append(f"profiling/cases/{family}")
    assert [path for path in wanted if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_primitives_are_launchers(name):
    """They say what a thread does, take every argument, and return nothing."""
    for module, function_name, function in primitives(name):
        where = f"{module.__name__}.{function_name}"
        assert (function.__doc__ or "").strip(), where
        signature = inspect.signature(function)
        assert signature.return_annotation in (None, "None"), where
        for parameter in signature.parameters.values():
            assert parameter.default is parameter.empty, where
            assert parameter.kind is parameter.POSITIONAL_OR_KEYWORD, where


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_sets_offer_the_runtime_the_same_functions(name):
    """What the runtime asks of a set, under the same names and parameters."""
    first = importlib.import_module(f"cvkern.kernels.{KERNEL_SETS[0]}")
    this = importlib.import_module(f"cvkern.kernels.{name}")
    for asked in (
        "start",
        "devices",
        "adopt",
        "view",
        "import_dlpack",
        "empty",
        "zeros",
        "write",
        "clear",
        "scratch",
        "to_numpy",
        "own_scratch",
        "record",
        "free_memory",
        "release_memory",
    ):
        expected = list(inspect.signature(getattr(first, asked)).parameters)
        assert list(inspect.signature(getattr(this, asked)).parameters) == expected, asked


FAMILIES = [
    path.parent.name
    for path in API.glob("[a-z]*/__init__.py")
    if path.parent.name not in {"app", "kernels", *cvkern._NAMESPACES}
]


def test_the_table_of_names_is_that_of_the_families():
    assert {name for name in cvkern._NAMES if name[0] != "_"} == set(FAMILIES)
    for module, names in cvkern._NAMES.items():
        if module[0] != "_":
            assert sorted(names) == sorted(importlib.import_module(f"cvkern.{module}").__all__)
    assert len(set(cvkern.__all__)) == sum(map(len, cvkern._NAMES.values()))


@pytest.mark.parametrize("name", cvkern.__all__)
def test_a_name_is_one_object(name):
    home = importlib.import_module(f"cvkern.{cvkern._HOMES[name]}")
    assert getattr(cvkern, name) is getattr(home, name)
    assert name in dir(cvkern)


@pytest.mark.parametrize("family", [*FAMILIES, *cvkern._NAMESPACES])
def test_no_function_hides_a_module(family):
    package = importlib.import_module(f"cvkern.{family}")
    modules = {m.name for m in pkgutil.iter_modules(getattr(package, "__path__", ()))}
    assert modules & set(getattr(package, "__all__", ())) == set()


def test_type_checkers_see_the_kernels():
    assert STUB.read_text() == stub(), "run: python -m tests.kernel_stub"
