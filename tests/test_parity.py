"""The kernel sets have the same modules, and the modules the same primitives."""

import importlib
import inspect
import pkgutil

import pytest
from calls import primitives

import cvkern
from cvkern._runtime import KERNEL_SETS

FAMILIES = [
    "circle_centers",
    "circles",
    "clouds",
    "depth",
    "disparity",
    "edges",
    "ellipses",
    "filters",
    "gradients",
    "lines",
    "rank",
    "segments",
    "semi_global",
    "shapes",
    "stereo",
    "stereo_cost",
    "window_matching",
]
SHARED = ["points"]  # by several families; in cvkern/ their module is private
# What radiance fields are made of: kernels of one package of the API.
RADIANCE = [
    "adam",
    "background",
    "composite",
    "dense",
    "encode",
    "hash",
    "heads",
    "loss",
    "march",
    "network",
    "occupancy",
    "rays",
    "shapes",
    "view",
    "voxel",
]


def signatures(kernel_set):
    return {
        f"{module.__name__.rpartition('.')[2]}.{name}": list(inspect.signature(function).parameters)
        for module, name, function in primitives(kernel_set)
    }


@pytest.mark.parametrize("other", KERNEL_SETS[1:])
def test_sets_have_the_same_primitives_and_parameters(other):
    assert signatures(other) == signatures(KERNEL_SETS[0])


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_the_families_are_those_of_the_api(name):
    """One name, one file in every layer."""
    package = importlib.import_module(f"cvkern.kernels.{name}")
    modules = {m.name for m in pkgutil.iter_modules(package.__path__) if m.name[0] != "_"}
    parts = [f"radiance_{part}" for part in RADIANCE]
    assert modules == {*FAMILIES, *SHARED, *parts}
    for family in modules - set(parts):
        importlib.import_module(f"cvkern.{'_' * (family in SHARED)}{family}")
    for family in modules:
        assert any(key.startswith(f"{family}.") for key in signatures(name))


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
        "adopt",
        "empty",
        "zeros",
        "write",
        "clear",
        "scratch",
        "to_numpy",
        "own_scratch",
        "record",
        "free_memory",
    ):
        expected = list(inspect.signature(getattr(first, asked)).parameters)
        assert list(inspect.signature(getattr(this, asked)).parameters) == expected, asked


def test_everything_public_is_in_all():
    public = {
        name
        for name, value in vars(cvkern).items()
        if not name.startswith("_") and (inspect.isfunction(value) or inspect.isclass(value))
    }
    assert public == set(cvkern.__all__)
    assert cvkern.__all__ == sorted(cvkern.__all__)
