"""Residual interpolation on extended planes, in Warp; the Taichi set has the equations.

Lines are worked on eight at a time on the CPU, and in blocks in shared memory on CUDA.
"""

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.codes.raw import BORDER, MARGINS, Step
from cvkern.kernels.warp._spans import spans
from cvkern.kernels.warp.raw.demosaicing import _residual_cuda
from cvkern.kernels.warp.raw.demosaicing._residual_cuda import REACH

LANES = 8  # lines at once on the CPU
_FIT = {name: f"{getattr(codes, name)!r}f" for name in ("FLOOR", "TINY", "SETTLED")}
_SMOOTH = {name: f"{getattr(codes, name)!r}f" for name in ("SMOOTH", "FLAT", "TINY", "SETTLED")}


def directions(red_row: int, red_column: int, planes: wp.array) -> None:
    """Find the differences between green and the other colour, by rows and by columns."""
    if planes.device.is_cuda:
        _residual_cuda.directions(red_row, red_column, planes)
        return
    _, height, width = planes.shape
    for vertical, (lines, length) in enumerate(((height, width), (width, height))):
        work = 20 * height * width
        inputs = [vertical, red_row, red_column]
        _differences.launch(-(-lines // LANES), length - 2 * REACH, work, inputs, [planes])


def green(red_row: int, red_column: int, planes: wp.array) -> None:
    """Find green from the differences of both directions."""
    if planes.device.is_cuda:
        _residual_cuda.green(red_row, red_column, planes)
        return
    rows, columns = planes.shape[1] - 2 * BORDER, planes.shape[2] - 2 * BORDER
    _green.launch(rows, columns, 20 * rows * columns, [red_row, red_column], [planes])


def chroma(step: int, row: int, column: int, result: int, planes: wp.array) -> None:
    """Do a step towards the colour whose samples are at (row, column) of each cell."""
    margin = MARGINS[Step(step)]
    if planes.device.is_cuda and step in (Step.WINDOWS, Step.TENTATIVE):
        _residual_cuda.windows(Step(step), row, column, planes)
        return
    rows, columns = planes.shape[1] - 2 * margin, planes.shape[2] - 2 * margin
    inputs = [step, margin, row, column, result]
    _chroma.launch(rows, columns, 10 * rows * columns, inputs, [planes])


@spans("_differences.h", LANES=LANES, REACH=REACH, PRIOR=f"{codes.PRIOR!r}f", **_FIT)
def _differences(
    row: int,
    left: int,
    right: int,
    vertical: int,
    red_row: int,
    red_column: int,
    planes: wp.array3d[float],
): ...


@spans("_green.h", BORDER=BORDER, **_SMOOTH)
def _green(
    row: int,
    left: int,
    right: int,
    red_row: int,
    red_column: int,
    planes: wp.array3d[float],
): ...


@spans(
    "_chroma.h",
    2,
    PRIOR=f"{codes.WINDOW_PRIOR!r}f",
    STEADY=f"{codes.STEADY!r}f",
    FEW=(0, 1),
    **{s.name: int(s) for s in list(Step)[:4]},
    **_FIT,
)
def _chroma(
    row: int,
    left: int,
    right: int,
    step: int,
    margin: int,
    own_row: int,
    own_column: int,
    result: int,
    planes: wp.array3d[float],
): ...
