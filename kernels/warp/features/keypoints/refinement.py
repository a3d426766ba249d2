"""Extrema between the pixels and levels of a scale space, in Warp.

The Taichi set has the equations. One thread takes a point; on the CPU, a slab of points. The code
(_refinement.h) is native, because on CUDA it is also part of a native kernel.
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.codes.features import MOVES
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp.features._levels import table

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FILE = "_refinement.h"


def refine(
    octaves: Sequence[wp.array],
    contrast: float,
    edge: float,
    margin: int,
    offsets: wp.array,
    cells: wp.array,
) -> None:
    """Fit a paraboloid to each extremum, and move it to where that has its own; a thread each.

    `cells` holds octave, level, row and column before and afterwards; the octave of an extremum
    that is not kept becomes -1.
    """
    count = cells.shape[0]
    inputs = [table(octaves), contrast, edge, margin]
    launch_each(_fit, count, 100 * count, inputs, [offsets, cells])


@_native.func_native(_FILE, MOVES=MOVES)
def fit_one(
    n: int,
    octaves: wp.array2d[wp.int64],
    contrast: float,
    edge: float,
    margin: int,
    offsets: wp.array2d[float],
    cells: wp.array2d[int],
):
    """Fit a paraboloid to extremum `n`."""


@wp.kernel
def _fit(
    stride: int,
    first: int,
    last: int,
    octaves: wp.array2d[wp.int64],  # (O, 4)
    contrast: float,  # least height
    edge: float,  # largest tr^2 / det
    margin: int,
    # outputs
    offsets: wp.array2d[float],  # (N, 4): row, column, level, height
    # in place
    cells: wp.array2d[int],  # (N, 4): octave, level, row, column
):
    for n in range(first + wp.tid(), last, stride):
        fit_one(n, octaves, contrast, edge, margin, offsets, cells)
