"""How Taichi's front end reads the source of our kernels: once, and without drawing it.

Taichi builds a kernel from its Python source in each process, even if the compiled kernel is in its
cache. For each node of the syntax it makes a message that an error would show, and draws the line
there with a mark under the node, wrapped to 80 columns: half of the time of building. For each call
of a function that it inlines, it searches the file for the function's source again. For each
function that is decorated, it looks through all modules to learn whether a class is around it.
"""

import functools
import os
import sys
from collections.abc import Callable
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast import ast_transformer_utils

_FOLDER = os.path.dirname(os.path.abspath(__file__)) + os.sep


def read_once() -> None:
    """Replace these functions of Taichi; for the code of others they act as before."""
    context = getattr(ast_transformer_utils, "ASTTransformerContext", None)
    _replace(context, "get_pos_info", _undrawn)
    _replace(kernel_impl, "getsourcelines", functools.cache)
    _replace(kernel_impl, "_inside_class", _classless)


def _replace(place: Any, name: str, made: Callable[..., Any]) -> None:
    """Replace a function, if this Taichi has it and it was not replaced yet."""
    found = getattr(place, name, None)
    if found is not None and not hasattr(found, "__wrapped__"):
        setattr(place, name, made(found))


def _undrawn(drawn: Callable[..., str]) -> Callable[..., str]:
    @functools.wraps(drawn)
    def position(self: Any, node: Any) -> str:
        if not self.file.startswith(_FOLDER):
            return drawn(self, node)
        line = node.lineno + self.lineno_offset
        return f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n'

    return position


def _classless(searched: Callable[..., bool]) -> Callable[..., bool]:
    """Return a replacement of `searched` for functions that are in no class, as all our kernels.

    The class, if there is one, is that many calls up; the function is decorated one call before.
    """

    @functools.wraps(searched)
    def inside(level_of_class_stackframe: int) -> bool:
        decorated = sys._getframe(level_of_class_stackframe - 1)
        if decorated.f_code.co_filename.startswith(_FOLDER):
            return False
        return searched(level_of_class_stackframe + 1)

    return inside
