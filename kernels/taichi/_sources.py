"""How Taichi's front end reads the source of our kernels: once, and without drawing it.

Taichi builds a kernel from its Python source in each process, even if the compiled kernel is in its
cache. For each node of the syntax it makes a message that an error would show, and draws the line
there with a mark under the node, wrapped to 80 columns: half of the time of building. For each call
of a function that it inlines, it searches the file for the function's source again.
"""

import functools
import os
from collections.abc import Callable
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast import ast_transformer_utils

_FOLDER = os.path.dirname(os.path.abspath(__file__)) + os.sep


def read_once() -> None:
    """Replace the two functions of Taichi; the code of others keeps its messages."""
    context = getattr(ast_transformer_utils, "ASTTransformerContext", None)
    drawn = getattr(context, "get_pos_info", None)
    if drawn is not None and not hasattr(drawn, "__wrapped__"):
        setattr(context, "get_pos_info", _undrawn(drawn))  # noqa: B010
    lines = getattr(kernel_impl, "getsourcelines", None)
    if lines is not None and not hasattr(lines, "__wrapped__"):
        setattr(kernel_impl, "getsourcelines", functools.cache(lines))  # noqa: B010


def _undrawn(drawn: Callable[..., str]) -> Callable[..., str]:
    @functools.wraps(drawn)
    def place(self: Any, node: Any) -> str:
        if not self.file.startswith(_FOLDER):
            return drawn(self, node)
        line = node.lineno + self.lineno_offset
        return f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n'

    return place
