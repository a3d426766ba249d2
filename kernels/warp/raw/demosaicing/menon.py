"""Menon's demosaicing on extended planes, in Warp.

The Taichi set has the equations. On the CPU a thread takes a slab of rows, on CUDA a run of pixels
of a row; the code of both is _menon.h.
"""

import warp as wp

from cvkern.kernels.codes.raw import Menon
from cvkern.kernels.warp._spans import spans

STEPS = ("DIFFERENCES", "GREEN", "AT_GREEN", "AT_CHROMA", "REFINE_GREEN", "REFINE_AT_CHROMA")


def menon(step: int, red_row: int, red_column: int, margin: int, planes: wp.array) -> None:
    """Do one step for all pixels but those at the border, `margin` wide."""
    rows, columns = planes.shape[1] - 2 * margin, planes.shape[2] - 2 * margin
    inputs = [step, red_row, red_column, margin]
    _menon.launch(rows, columns, 4 * rows * columns, inputs, [planes])


@spans("_menon.h", 2, **{name: int(Menon[name]) for name in STEPS})
def _menon(
    row: int,
    left: int,
    right: int,
    step: int,
    red_row: int,
    red_column: int,
    margin: int,
    planes: wp.array3d[float],
): ...
