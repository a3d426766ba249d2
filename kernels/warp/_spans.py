"""Kernels over parts of rows, whose body is C++ that compiles for both devices.

A body has the form ``void NAME(int row, int left, int right, ARRAYS...)`` and does the elements
``left`` to ``right`` of a row. On the CPU each slab calls it for whole rows; on CUDA each thread
calls it for a part of a row. The constant PART says how many elements a body keeps at once.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import warp as wp

from . import _native
from ._launch import launch, launch_slabs, slabs

OPTIONS = {"enable_backward": False, "fuse_fp": False}
PART = 128  # elements that a body keeps at once on the CPU

_SLAB = """def {name}(slab, first, last, columns, {names}):
    for row in range(first, last):
        body(row, 0, columns, {names})
"""
_PART = """def {name}(columns, part, {names}):
    i = wp.tid()
    parts = (columns + part - 1) // part
    left = i % parts * part
    body(i // parts, left, wp.min(left + part, columns), {names})
"""


class Spans(NamedTuple):
    """The kernels of a body, made when they are first used."""

    cpu: Callable[[], wp.Kernel]
    cuda: Callable[[], wp.Kernel]
    part: int

    def launch(
        self, rows: int, columns: int, work: int, inputs: Sequence[Any], outputs: Sequence[Any]
    ) -> None:
        """Do `columns` elements of each of `rows` rows, which cost as much as `work` elements."""
        first = outputs[0]
        if first.device.is_cuda:
            count = rows * -(-columns // self.part)
            launch(self.cuda(), count, [columns, self.part, *inputs], outputs)
        else:
            launch_slabs(self.cpu(), rows, slabs(rows, work), [columns, *inputs], outputs)


def spans(file: str, part: int = 1, **constants: Any) -> Callable[[Any], Spans]:
    """Return a decorator that makes the kernels of the body of the same name in a file.

    A constant that differs on CUDA is a pair: its value on the CPU, then that on CUDA.
    """

    def make(stub: Any) -> Spans:
        kernels: dict[bool, wp.Kernel] = {}

        def on(cuda: bool) -> wp.Kernel:
            if cuda not in kernels:
                kernels[cuda] = _kernel(stub, file, cuda, part, constants)
            return kernels[cuda]

        return Spans(lambda: on(False), lambda: on(True), part)

    return make


def _kernel(stub: Any, file: str, cuda: bool, part: int, constants: dict[str, Any]) -> wp.Kernel:
    own = {
        key: value[cuda] if isinstance(value, tuple) else value for key, value in constants.items()
    }
    body = _native.func_native(file, PART=part if cuda else PART, **own)(stub)
    types = dict(list(inspect.get_annotations(stub).items())[3:])
    name = f"{stub.__name__}_{'part' if cuda else 'slab'}"
    text = (_PART if cuda else _SLAB).format(name=name, names=", ".join(types))
    head = ("columns", "part") if cuda else ("slab", "first", "last", "columns")
    types = {**dict.fromkeys(head, int), **types}
    function = _native.forward(name, text, stub, body, types)
    return wp.kernel(function, module="unique", module_options=OPTIONS)
