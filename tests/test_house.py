"""The laws of the house: sizes, signatures, imports, names, words, and one place for each trick."""

import ast
import re
import runpy
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("cvkern", "kernels", "tests", "profiling", "docs", ".ci")
MOST_LINES, MOST_MODULES, MOST_PARAMETERS, MOST_LINES_OF_C = 400, 20, 12, 3
WRITTEN_BY_PROGRAM = {"cvkern/_kernels.pyi"}
LINT = runpy.run_path(str(ROOT / ".ci" / "comments.py"))


@cache
def files(*endings, folders=FOLDERS):
    """Return the paths of the files of some folders, without what the link in cvkern/ repeats."""
    return sorted(
        path.relative_to(ROOT)
        for folder in folders
        for path in (ROOT / folder).rglob("*")
        if path.suffix in endings
        and not path.is_relative_to(ROOT / "cvkern" / "kernels")
        and path.relative_to(ROOT).as_posix() not in WRITTEN_BY_PROGRAM
    )


@cache
def tree(path):
    return ast.parse((ROOT / path).read_text(encoding="utf-8"))


def names(paths):
    return {path.as_posix() for path in paths}


def long_files():
    for path in files(".py", ".cu", ".h", ".pyi"):
        if len((ROOT / path).read_text(encoding="utf-8").splitlines()) > MOST_LINES:
            yield path


def full_folders():
    count = Counter(path.parent for path in files(".py"))
    return [folder for folder, modules in count.items() if modules > MOST_MODULES]


def test_files_are_short():
    assert names(long_files()) == set(), f"a file has at most {MOST_LINES} lines"


def test_folders_are_small():
    assert names(full_folders()) == set(), f"a folder has at most {MOST_MODULES} modules"


# --- signatures ----------------------------------------------------------------------------------

COMMANDS = "cvkern/app/commands/"  # the options of a command are its parameters
# Taichi's kernels cannot take structures of arrays but by packs that cost 0.7 ms a launch on CUDA
# (measured on an H200, Taichi 1.7). The one of voxels, of both passes, has 20 arrays; that of the
# gradients of splats has 18.
TAICHI_ARRAYS = {
    "kernels/taichi/radiance/fields/splats/projection.py",
    "kernels/taichi/radiance/fields/voxel/_march.py",
}


def parameters(path, function):
    """Count what a call passes by position; keyword options count below the API only."""
    given = function.args
    names = [a.arg for a in (*given.posonlyargs, *given.args) if a.arg not in ("self", "cls")]
    name = getattr(function, "name", "_")
    options = path.parts[0] == "cvkern" and not name.startswith("_")
    return len(names) + (0 if options else len(given.kwonlyargs))


def long_signatures():
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
    return {
        path
        for path in files(".py", folders=("cvkern", "kernels"))
        if not path.as_posix().startswith(COMMANDS)
        for node in ast.walk(tree(path))
        if isinstance(node, kinds) and parameters(path, node) > MOST_PARAMETERS
    }


def test_signatures_are_short():
    law = f"a function has at most {MOST_PARAMETERS} parameters"
    assert names(long_signatures()) == TAICHI_ARRAYS, law


# --- native code ---------------------------------------------------------------------------------


def is_c(text):
    """Tell whether a string has more than three lines of C: they end in one of its marks."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    ends = sum(line.endswith((";", "{", "}", "\\")) for line in lines)
    return len(lines) > MOST_LINES_OF_C and 2 * ends >= len(lines)


def strings_of_c():
    return {
        path
        for path in files(".py", folders=("kernels", "tests"))
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and is_c(node.value)
    }


def test_native_code_is_in_files_of_its_own():
    assert names(strings_of_c()) == set(), f"a string has at most {MOST_LINES_OF_C} lines of C"


def test_c_is_told_from_words():
    lines = ["int i = 0;", "for (; i < 4; i++) {", "  a[i] = i;", "}"]
    assert is_c("\n".join(lines))
    assert not is_c("\n".join(lines[:3]))
    assert not is_c(__doc__ or "")


# --- imports and names ---------------------------------------------------------------------------


def imported(path):
    """Return the absolute names that a module imports, and how deep its relative ones reach."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, 0) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            yield from ((f"{base}.{alias.name}", node.level) for alias in node.names)


def test_kernels_know_nothing_of_the_api():
    for path in files(".py", folders=("kernels",)):
        for name, level in imported(path):
            assert level < len(path.parts), (path, name)
            if level == 0 and name.partition(".")[0] == "cvkern":
                assert name.startswith("cvkern.kernels"), (path, name)


NAMES = {"utils", "util", "common", "misc", "helpers", "helper", "core", "tools", "stuff"}


def test_names_say_what_is_inside():
    parts = {part for path in files(".py", ".cu", ".h") for part in (*path.parts[:-1], path.stem)}
    assert {part for part in parts if part.strip("_") in NAMES} == set()


# --- one place -----------------------------------------------------------------------------------

INSIDES = (
    r"object\.__new__\(wp\b", r"set_param_at_index", r"record_cmd", r"\.__ctype__\(",
    r"\bwp\._src\b", r"\bwarp\._src\b", r"\bwp\.context\b",
)  # fmt: skip


@pytest.mark.parametrize(
    ("pattern", "folders", "allowed"),
    [
        ("|".join(INSIDES), ("cvkern", "kernels"), {"kernels/warp/_internals.py"}),
        (r"CVKERN_NUM_THREADS\"", ("cvkern", "kernels"), {"kernels/_threads.py"}),
        (r"\brt\._?set\b|\._set\.", ("cvkern",), {"cvkern/_runtime.py"}),
        (r"data_ptr|__cuda_array_interface__", ("cvkern", "kernels"), {"cvkern/_arrays.py"}),
        (r"hasattr\(\w+, \"at\"\)", ("cvkern", "kernels"), set()),
    ],
)
def test_what_stands_in_one_place(pattern, folders, allowed):
    found = {
        path.as_posix()
        for path in files(".py", folders=folders)
        if re.search(pattern, (ROOT / path).read_text(encoding="utf-8"))
    }
    assert found == allowed


# --- words ---------------------------------------------------------------------------------------


def test_comments_begin_as_sentences_do():
    assert LINT["offenders"]() == {}, "a comment is a sentence, or names its object"


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("x = 1  # of an array", True),
        ("# As above.", True),
        ("# Which is so.", True),
        ("# Often enough.", False),
        ("x = '# of'  # pixels of a tile", False),
        ("# The number\n# of threads.", False),
        ("# The number.\n\n# of threads", True),
        ("#: that", False),
    ],
)
def test_the_lint_of_comments(line, found, tmp_path):
    file = tmp_path / "example.py"
    file.write_text(line + "\n")
    said = [LINT["BEGINS"].match(text) is not None for _, text in LINT["comments"](file)]
    assert any(said) is found
