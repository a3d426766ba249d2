"""Residual interpolation on CUDA, in native code: the steps that add up windows.

Along lines, a block has parts of some of them in shared memory. Beside green, a thread takes a cell
of two by two pixels, and then a warp goes down a strip of columns.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch

OPTIONS = {"enable_backward": False, "fuse_fp": False}
THREADS = 256
LINES = 8  # side by side, of 32 bytes: a sector of memory
SIZE = (
    154  # pixels of a line that a block reads: its arrays fill 48 KiB; pairs are twice its threads
)
REACH = 20  # pixels along a line, on either side, that a difference depends on
LONG = 32  # rows of a warp that goes down a strip of columns
WIDE = 26  # columns that it writes
DEEP, BROAD = 36, 60  # the same of green
MOST = 2**14  # blocks, which take parts in turns
FIT = {name: f"{getattr(codes, name)!r}f" for name in ("FLOOR", "TINY", "SETTLED")}


def directions(red_row: int, red_column: int, planes: wp.array) -> None:
    """Find the differences between green and the other colour, by rows and by columns."""
    _, height, width = planes.shape
    for vertical, (lines, length) in enumerate(((height, width), (width, height))):
        parts = -(-(length - 2 * REACH) // (SIZE - 2 * REACH))
        blocks = min(-(-lines // LINES) * parts, MOST)
        inputs = [vertical, red_row, red_column]
        launch(line_differences, blocks * THREADS, inputs, [planes], THREADS)


def green(red_row: int, red_column: int, planes: wp.array) -> None:
    """Find green from the differences of both directions."""
    rows, columns = (n - 2 * codes.BORDER for n in planes.shape[1:])
    warps = -(-rows // DEEP) * -(-columns // BROAD)
    threads = min(32 * warps, MOST * THREADS)
    launch(green_strips, threads, [red_row, red_column], [planes])


def windows(step: codes.Step, row: int, column: int, planes: wp.array) -> None:
    """Do one of two steps beside green, for the colour whose samples are at (row, column)."""
    margin = codes.MARGINS[step]
    rows, columns = (n - 2 * margin for n in planes.shape[1:])
    if step == codes.Step.WINDOWS:
        cells = (rows // 2 + 1) * (columns // 2 + 1)
        threads = min(cells, MOST * THREADS)
        launch(cell_windows(row, column), threads, [margin], [planes])
    else:
        warps = -(-rows // LONG) * -(-columns // WIDE)
        threads = min(32 * warps, MOST * THREADS)
        launch(mean_windows, threads, [margin], [planes])


@lru_cache
def cell_windows(row: int, column: int) -> wp.Kernel:
    """Make the kernel for a place of the samples."""

    @_native.kernel(
        "_residual_cuda.cu",
        OPTIONS,
        PRIOR=f"{codes.WINDOW_PRIOR!r}f",
        ROW=row,
        COLUMN=column,
        **FIT,
    )
    def cell_windows(
        margin: int,
        # outputs
        planes: wp.array3d[float],
    ):
        """Forward to the native code."""

    return cell_windows


@_native.kernel(
    "_green_cuda.cu",
    OPTIONS,
    BORDER=codes.BORDER,
    LONG=DEEP,
    **{name: f"{getattr(codes, name)!r}f" for name in ("SMOOTH", "FLAT", "TINY", "SETTLED")},
)
def green_strips(
    red_row: int,
    red_column: int,
    # outputs
    planes: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel("_residual_cuda.cu", OPTIONS, LONG=LONG, **FIT)
def mean_windows(
    margin: int,
    # outputs
    planes: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel(
    "_residual_cuda.cu",
    OPTIONS,
    launch_bounds=(THREADS, 4),
    PRIOR=f"{codes.PRIOR!r}f",
    LINES=LINES,
    SIZE=SIZE,
    REACH=REACH,
    THREADS=THREADS,
    **FIT,
)
def line_differences(
    vertical: int,
    red_row: int,
    red_column: int,
    # outputs
    planes: wp.array3d[float],
):
    """Forward to the native code."""
