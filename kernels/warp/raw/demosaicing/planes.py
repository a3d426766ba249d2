"""Copies between images and extended planes of floats, in Warp.

The Taichi set says how planes are extended. On the CPU a thread takes a slab of rows, on CUDA a run
of pixels of a row (_planes.h).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.raw import MARGIN
from cvkern.kernels.warp._spans import Spans, spans
from cvkern.kernels.warp.raw._types import constants


def extend(raw: wp.array, top: int, planes: wp.array) -> None:
    """Copy the rows from `top` on to the first plane, and `MARGIN` mirrored pixels around them."""
    _, rows, columns = planes.shape
    _extend(raw.dtype).launch(rows, columns, rows * columns, [raw, top], [planes])


def join(
    planes: wp.array, red: int, green: int, blue: int, top: int, rows: int, colours: wp.array
) -> None:
    """Round three planes, without their margins, to `rows` rows of colours from `top` on."""
    columns = colours.shape[1]
    inputs = [planes, red, green, blue, top]
    _join(colours.dtype).launch(rows, columns, 3 * rows * columns, inputs, [colours])


@lru_cache
def _extend(scalar: Any) -> Spans:
    @spans("_planes.h", 4, TYPE=constants(scalar)["TYPE"], MARGIN=MARGIN)
    def extend(
        row: int,
        left: int,
        right: int,
        raw: wp.array2d[scalar],
        top: int,
        planes: wp.array3d[float],
    ): ...

    return extend


@lru_cache
def _join(scalar: Any) -> Spans:
    @spans("_planes.h", 2, MARGIN=MARGIN, **constants(scalar))
    def join(
        row: int,
        left: int,
        right: int,
        planes: wp.array3d[float],
        red: int,
        green: int,
        blue: int,
        top: int,
        colours: wp.array3d[scalar],
    ): ...

    return join
