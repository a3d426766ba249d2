"""The disparity with the smallest cost."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_image, check_integer
from cvkern._runtime import runtime
from cvkern.kernels.codes.stereo import MAX_COSTS, MAX_DISPARITIES, Rule, Subpixel, Winners


class Winner(NamedTuple):
    """The best disparity of each pixel."""

    disparity: Any
    """The disparity in pixels, (H, W) float32; NaN where the winner is not unique."""
    cost: Any
    """Cost of the winner, (H, W) float32."""
    confidence: Any
    """1 minus the winner's cost over the cost of its best rival, (H, W) float32."""


def winner_take_all(
    costs: Any,
    *,
    first: int = 0,
    subpixel: bool | str = True,
    uniqueness: int = 0,
) -> Winner:
    """Find the disparity with the smallest cost for each pixel.

    If several disparities have the smallest cost, the smallest disparity wins.

    Parameters
    ----------
    costs : array of shape (H, W, D)
        Any real dtype. uint8 and uint16 are compared as integers, others as float32. A float32
        cost may be infinite, and NaN counts as infinite.
    first : int, default 0
        The disparity of ``costs[..., 0]``.
    subpixel : bool or {'parabola', 'equiangular'}, default True
        Curve through the smallest cost c at disparity d and its neighbours a and b; the sub-pixel
        disparity is at its minimum. 'parabola' (or True) gives
        ``d + (a - b) / (2 (a + b - 2 c))``. 'equiangular', two straight lines of opposite slope,
        gives ``d + (a - b) / (2 (max(a, b) - c))``, which suits absolute differences. The first
        and the last disparity have no fit.
    uniqueness : int, default 0
        Per cent, 0 to 99. A winner is not unique if a rival, more than one disparity away, has
        ``cost * (100 - uniqueness) < 100 * c``.

    Returns
    -------
    Winner
        Named tuple of `disparity`, `cost` and `confidence`, each (H, W) float32. The confidence is
        1 - c / r, where r is the smallest cost more than one disparity away, or 1 if there is no
        such cost. It is meaningful only for costs that are not negative.

    Raises
    ------
    TypeError
        If `costs` are not real numbers.
    ValueError
        If `costs` are empty, not 3-D or more than 2^31 - 1, D is above 32768, or an option is out
        of range.

    Notes
    -----
    Every bit is the same on every device and kernel set.

    References
    ----------
    .. [1] D. Scharstein and R. Szeliski, "A taxonomy and evaluation of dense two-frame stereo
       correspondence algorithms", IJCV 47, 2002.
    .. [2] X. Hu and P. Mordohai, "A quantitative evaluation of confidence measures for stereo
       vision", IEEE PAMI 34(11), 2012 (the peak ratio).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> costs = np.array([[[8, 2, 4, 9, 5]]], np.uint8)
    >>> winner = cvkern.winner_take_all(costs, first=10, uniqueness=20)
    >>> float(winner.disparity[0, 0]), float(winner.cost[0, 0])
    (11.25, 2.0)
    """
    costs = check_image(costs, ndim=(3,), name="costs", most=MAX_COSTS)
    check_depth(costs.shape[2])
    first = check_integer(first, "first", -(2**24), 2**24)
    fit = check_subpixel(subpixel)
    uniqueness = check_integer(uniqueness, "uniqueness", 0, 99)
    dtype = library(costs).dtype(costs)
    if dtype not in (np.uint8, np.uint16):
        dtype = np.dtype(np.float32)
    rt = runtime(costs)
    shape = tuple(costs.shape[:2])
    index = rt.scratch("winner.index", shape, np.int32)
    results = Winner(*(rt.empty(shape) for _ in Winner._fields))
    winners = Winners(index, *(rt.adopt(a) for a in results))
    rt.stereo.winners.pick(rt.adopt(costs, dtype), Rule(first, fit, uniqueness), winners)
    return Winner(*(rt.release(a) for a in results))


def check_subpixel(subpixel: bool | str) -> Subpixel:
    """Return the code of a sub-pixel fit."""
    if isinstance(subpixel, (bool, np.bool_)):
        return Subpixel.PARABOLA if subpixel else Subpixel.NONE
    return Subpixel[check_choice(subpixel, ("parabola", "equiangular"), "subpixel").upper()]


def check_depth(depth: int) -> None:
    """Refuse more disparities than kernels can number."""
    if depth > MAX_DISPARITIES:
        raise ValueError(f"costs must have at most {MAX_DISPARITIES} disparities, got {depth}")
