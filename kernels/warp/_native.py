"""Functions and kernels whose body is C++ or CUDA, read from a file beside the Python module.

A ``.h`` file has code for the CPU, or for both devices, a ``.cu`` file code for CUDA. It holds
whole functions, so that editors colour them and clang-format formats them::

    // needs RADIUS
    void blur_row(int row, wp::array_t<float> image, wp::array_t<float> out) { ... }

The module declares one by a signature with the same parameters, in the same order::

    @_native.func_native("_blur_cpu.h", RADIUS=2)
    def blur_row(row: int, image: wp.array2d[float], out: wp.array2d[float]): ...

The constants become ``#define`` lines before the body. A type is a constant too:
``SCALAR=wp.uint8`` for ``wp::array_t<SCALAR>``. A line ``#include "NAME"`` at the top of a file
inserts the text of another file, whose path is relative to the first, before every function of the
file. A rule that several functions share is a ``struct`` with static functions in such a file. It
names its constants in ``// needs`` lines of its own, and the functions of the including file need
them as well.

`kernel` declares a kernel in the same way. On the CPU it runs over slabs (`_launch.launch_slabs`);
its first parameters are the slab, the first row and the row after the last. `each` declares such a
kernel from a function of one row. On CUDA a kernel finds its thread by ``threadIdx`` and
``blockIdx``.
"""

from __future__ import annotations

import inspect
import linecache
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import warp as wp

_INCLUDE = re.compile(r'^#include "([\w./]+)"$', re.MULTILINE)
_NEEDS = re.compile(r"^// needs ([\w, ]+)$", re.MULTILINE)
_COMMENTS = r"((?:^//[^\n]*\n)*)"


def func_native(file: str, **constants: Any) -> Callable[[Any], wp.Function]:
    """Return a decorator that makes a Warp function from the C++ function of the same name.

    Warp reads the return type from the stub only if its decorator is written as an attribute with
    this name. So the name is fixed, and users must import the module, not the function.
    """

    def make(stub: Any) -> wp.Function:
        return wp.func_native(_snippet(stub, file, constants))(stub)

    return make


def kernel(
    file: str,
    options: dict[str, Any] | None = None,
    *,
    launch_bounds: tuple[int, int] | None = None,
    **constants: Any,
) -> Callable[[Any], wp.Kernel]:
    """Return a decorator that makes a kernel from the C++ function of the same name.

    With `options` the kernel has its own Warp module with these options, compiled when the kernel
    is first launched. Without, it belongs to the module of the Python file, which is compiled as a
    whole, with the options that the file sets.
    """

    def make(stub: Any) -> wp.Kernel:
        types = inspect.get_annotations(stub)
        names = ", ".join(types)
        source = f"def {stub.__name__}({names}):\n    body({names})\n"
        body = func_native(file, **constants)(stub)
        function = forward(stub.__name__, source, stub, body, types)
        if options is None:
            return wp.kernel(function, launch_bounds=launch_bounds)
        return wp.kernel(
            function, module="unique", module_options=options, launch_bounds=launch_bounds
        )

    return make


def each(file: str, **constants: Any) -> Callable[[Any], wp.Kernel]:
    """Return a decorator that makes a kernel over slabs from the C++ function of one item.

    The first parameter of the function is the item, a row for example. The kernel has the slab, its
    first item and the item after its last in that place.
    """

    def make(stub: Any) -> wp.Kernel:
        item, *names = inspect.get_annotations(stub)
        types = {"slab": int, "first": int, "last": int, **inspect.get_annotations(stub)}
        del types[item]
        source = (
            f"def {stub.__name__}({', '.join(types)}):\n"
            f"    for {item} in range(first, last):\n"
            f"        body({', '.join([item, *names])})\n"
        )
        body = func_native(file, **constants)(stub)
        return wp.kernel(forward(stub.__name__, source, stub, body, types))

    return make


def forward(name: str, source: str, stub: Any, body: wp.Function, types: dict[str, Any]) -> Any:
    """Return the Python function `name` of `source`, which calls `body`; Warp can compile it.

    `types` are the annotations of its parameters. It belongs to the module of `stub`.
    """
    # Warp reads the source of a kernel from the interpreter's line cache.
    place = f"<{stub.__module__}:{name}:{id(body)}>"
    linecache.cache[place] = (len(source), None, source.splitlines(keepends=True), place)
    space: dict[str, Any] = {"body": body, "wp": wp, "__name__": stub.__module__}
    exec(compile(source, place, "exec"), space)
    function = space[name]
    function.__annotations__, function.__doc__ = types, stub.__doc__
    return function


def _snippet(stub: Any, file: str, constants: dict[str, Any]) -> str:
    """Return the code that Warp puts between the braces of `stub`; check that both agree."""
    name, path = stub.__name__, Path(inspect.getfile(stub)).parent / file
    needs, parameters, body = _function(path, name)
    shared_needs, shared = _shared(path)
    needs = needs | shared_needs
    if needs != set(constants):
        raise ImportError(f"{file}: {name} needs {sorted(needs)}, got {sorted(constants)}")
    declared = [p for p in inspect.get_annotations(stub) if p != "return"]
    if declared != list(parameters):
        raise ImportError(f"{file}: {name} takes {list(parameters)}, got {declared}")
    defines = "".join(f"#define {key} {_text(value)}\n" for key, value in constants.items())
    undefines = "".join(f"#undef {key}\n" for key in constants)
    # Some pragmas must directly follow a brace, so the body keeps its own braces.
    return f"\n{defines}{shared}{{{body}}}\n{undefines}"


def _text(constant: Any) -> str:
    """Return a constant as C++: the name of a Warp type, or else the constant itself."""
    return f"wp::{constant.__name__}" if isinstance(constant, type) else str(constant)


@lru_cache
def _function(path: Path, name: str) -> tuple[set[str], tuple[str, ...], str]:
    """Return the constants that a function of a file needs, its parameters and its body."""
    text = path.read_text(encoding="utf-8")
    head = re.search(rf"{_COMMENTS}^[\w:<> ]+\b{name}\(([^)]*)\)\s*\{{", text, re.MULTILINE)
    if head is None:
        raise ImportError(f"{path.name} must have a function {name}")
    depth, end = 1, head.end()
    while depth:
        if end == len(text):
            raise ImportError(f"{path.name}: {name} must end with a brace")
        depth += {"{": 1, "}": -1}.get(text[end], 0)
        end += 1
    needs = _named(head[1])
    parameters = re.findall(r"(\w+)\s*(?:,|$)", re.sub(r"<[^>]*>", "", head[2]).strip())
    return needs, tuple(parameters), text[head.end() : end - 1]


@lru_cache
def _shared(path: Path) -> tuple[set[str], str]:
    """Return the constants that the included files need, and the text of these files."""
    needs: set[str] = set()
    shared = ""
    for other in _INCLUDE.findall(path.read_text(encoding="utf-8")):
        place = path.parent / other
        text = place.read_text(encoding="utf-8")
        inner_needs, inner = _shared(place)
        needs |= inner_needs | _named(text)
        shared += inner + _INCLUDE.sub("", text).replace("#pragma once\n", "")
    return needs, shared


def _named(text: str) -> set[str]:
    """Return the constants that ``// needs`` lines name."""
    return set(re.findall(r"\w+", " ".join(_NEEDS.findall(text))))
