"""Docstrings keep their promises: examples run, sections exist, shapes are true."""

import doctest
import importlib
import inspect
import re

import numpy as np
import pytest

import cvkern
from tests.calls import CALLS, blobs, fields

MODULES = ["cvkern", "cvkern.clouds", "cvkern.images", "cvkern.radiance"]
HEIGHT, WIDTH = 21, 34


def public():
    """Yield (name, object) of everything a user may call."""
    for module_name in MODULES:
        module = importlib.import_module(module_name)
        names = getattr(module, "__all__", None) or [n for n in vars(module) if n[0] != "_"]
        for name in names:
            found = getattr(module, name)
            if getattr(found, "__module__", "").startswith("cvkern") and callable(found):
                yield f"{module_name}.{name}", found


PUBLIC = dict(public())
FUNCTIONS = {name: found for name, found in PUBLIC.items() if inspect.isfunction(found)}


def section(text, title):
    """Return the lines of one numpydoc section, or None."""
    pattern = rf"^{title}\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)"
    found = re.search(pattern, inspect.cleandoc(text), re.MULTILINE | re.DOTALL)
    return found.group(1) if found else None


def parameters(text):
    """Return the parameters that a Parameters section lists."""
    heads = re.findall(r"^(\*{0,2}\w[\w, *]*?)(?: : .*)?$", section(text, "Parameters") or "", re.M)
    return [name.strip("* ") for head in heads for name in head.split(",")]


def test_there_is_something_to_test():
    assert {"cvkern.gaussian", "cvkern.use", "cvkern.canny"} <= set(PUBLIC)
    assert len(FUNCTIONS) >= 10


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_run(name, tmp_path, monkeypatch):
    """With one kernel set: the tests of each family compare both."""
    monkeypatch.chdir(tmp_path)  # some write files
    found = doctest.DocTestFinder(recurse=False).find(PUBLIC[name], name, globs={})
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for test in found:
        said: list[str] = []
        with cvkern.use(backend="warp"):
            runner.run(test, out=said.append)
        assert runner.failures == 0, "".join(said)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_document_parameters_results_and_errors(name):
    function = FUNCTIONS[name]
    text = inspect.getdoc(function) or ""
    summary = text.splitlines()[0]
    assert summary.endswith(".")
    assert len(summary) < 100
    assert sorted(parameters(text)) == sorted(inspect.signature(function).parameters)
    titles = {title for title in ("Returns", "Raises", "Examples") if section(text, title)}
    wanted = {"Returns", "Raises", "Examples"}
    if name.startswith(("cvkern.images.", "cvkern.radiance.")):
        wanted.discard("Examples")
    if function.__annotations__.get("return") in (None, "None"):
        wanted.discard("Returns")
    assert wanted <= titles


def test_use_documents_itself():
    text = inspect.getdoc(cvkern.use) or ""
    assert parameters(text) == list(inspect.signature(cvkern.use).parameters)
    assert section(text, "Raises")
    assert section(text, "Examples")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_documented_defaults_are_true(name):
    function = FUNCTIONS[name]
    listed = section(inspect.getdoc(function) or "", "Parameters") or ""
    for parameter in inspect.signature(function).parameters.values():
        line = re.search(rf"^{parameter.name}(?:, \w+)* : .*default (\S+)$", listed, re.MULTILINE)
        if line:
            assert line.group(1) == repr(parameter.default), parameter.name


def shape_of(text, image):
    """Return the shape that "(H, W)" or "the shape of `image`" means; None for any size."""
    sizes = {"H": image.shape[0], "W": image.shape[1], "2": 2, "3": 3, "4": 4}
    if "shape of `image`" in text or "shape and dtype of `image`" in text:
        return image.shape
    listed = re.search(r"\(((?:[CDHKMNRTW234],? ?)+)\)", text)
    assert listed, text
    return tuple(sizes.get(size) for size in re.findall(r"\w", listed.group(1)))


def dtype_of(text, image):
    found = re.search(r"\b(bool|uint8|int32|float32)\b", text)
    if "dtype of `image`" in text:
        return image.dtype
    assert found, text
    return np.dtype(found.group(1))


@pytest.mark.parametrize("name", CALLS)
def test_documented_shapes_and_dtypes_are_true(name):
    image = blobs(HEIGHT, WIDTH)
    calls = {"derivative": "gaussian", "gradient_sobel": "gradient", "canny_sectors": "canny",
             "canny_gaussian": "canny"}  # fmt: skip
    function = FUNCTIONS[f"cvkern.{calls.get(name, name)}"]
    got = CALLS[name](image)
    if isinstance(got, tuple):  # its fields say it themselves, in the order of the source
        source = inspect.getsource(type(got))
        texts = re.findall(r'^    \w+: Any\n    """(.*?)"""', source, re.MULTILINE | re.DOTALL)
        assert len(texts) == len(got)
    else:
        texts = [section(inspect.getdoc(function) or "", "Returns")]
    for array, text in zip(fields(got), texts, strict=True):
        assert text, "no section Returns"
        shape = shape_of(text, image)
        assert len(array.shape) == len(shape)
        assert all(want in (None, have) for have, want in zip(array.shape, shape, strict=True))
        assert array.dtype == dtype_of(text, image)
