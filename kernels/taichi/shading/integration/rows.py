"""Poisson's equation along rows, after cosine transforms along columns, in Taichi."""

from collections.abc import Sequence

import numpy as np

from cvkern.kernels.taichi.shading.integration.cosines import divide, stage


def solve(
    waves: np.ndarray,
    quarters: np.ndarray,
    radices: Sequence[int],
    down: np.ndarray,
    along: np.ndarray,
    one: np.ndarray,
    two: np.ndarray,
) -> None:
    """Transform `one` along rows, divide by eigenvalues and pixels, and transform back, to `two`.

    Both are pairs of rows, and `one` may be written to. The radices are those of the stages.
    """
    for sign in (-1.0, 1.0):
        before = 1
        for radix in radices:
            stage(one, waves, radix, before, 1, sign, two)
            one, two = two, one
            before *= radix
        if sign < 0.0:
            divide(one, quarters, down, along, two)
            one, two = two, one
