"""Poisson's equation along rows, after cosine transforms along columns, in Warp.

On CUDA a block does all steps of a row that fits its shared memory.
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.shading.integration import _rows_cuda as cuda
from cvkern.kernels.warp.shading.integration.cosines import divide, stage


def solve(
    waves: wp.array,
    quarters: wp.array,
    radices: Sequence[int],
    down: wp.array,
    along: wp.array,
    one: wp.array,
    two: wp.array,
) -> None:
    """Transform `one` along rows, divide by eigenvalues and pixels, and transform back, to `two`.

    Both are pairs of rows, and `one` may be written to. The radices are those of the stages.
    """
    if two.device.is_cuda and one.shape[1] <= cuda.LONGEST:
        blocks = min(one.shape[0], cuda.MOST)
        inputs = [one, waves, quarters, down, along]
        launch(cuda.solve_row, blocks * cuda.THREADS, inputs, [two], cuda.THREADS)
        return
    for sign in (-1.0, 1.0):
        before = 1
        for radix in radices:
            stage(one, waves, radix, before, 1, sign, two)
            one, two = two, one
            before *= radix
        if sign < 0.0:
            divide(one, quarters, down, along, two)
            one, two = two, one
