"""Semi-global aggregation of matching costs."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_dtype, check_image, check_integer, check_positive
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.stereo import MAX_COSTS, Penalties
from cvkern.stereo._strips import cut_strips
from cvkern.stereo.winners import check_depth

PATHS = (4, 8, 16)


def aggregate_semi_global(
    costs: Any,
    p1: int,
    p2: int,
    *,
    paths: int = 8,
    guide: Any = None,
    contrast: float = 20.0,
    largest_cost: int | None = None,
    max_bytes: int | None = None,
) -> Any:
    """Sum the costs of the cheapest paths to each pixel and disparity, from all directions.

    Along a path, a change of disparity by one costs `p1`, any other change costs `p2`.

    Parameters
    ----------
    costs : array of shape (H, W, D), uint8 or uint16
        Matching costs, as :func:`stereo_cost` returns them.
    p1, p2 : int
        Penalties, ``0 <= p1 <= p2``, in the units of the costs.
    paths : {4, 8, 16}, default 8
        Number of directions: 4 along rows and columns, 8 with the diagonals, 16 with knight's
        moves as well.
    guide : array of shape (H, W), uint8, optional
        An image, usually the left one of the pair, because depth changes where brightness does. If
        neighbouring pixels of a path differ by g in this image, the penalty
        ``max(p1, floor(p2 * contrast / (contrast + g)))`` replaces `p2`.
    contrast : float, default 20.0
        Difference of the guide's values that halves `p2`.
    largest_cost : int, optional
        An upper bound of the costs; if a cost exceeds it, the sums are meaningless. By default 255
        for uint8. For uint16 the largest cost is computed, and the host waits for the GPU.
    max_bytes : int, optional
        Bound on the memory of the result and of the work, see Notes; none by default.

    Returns
    -------
    array of shape (H, W, D), uint16
        Sums over the paths.

    Raises
    ------
    TypeError
        If `costs` are neither uint8 nor uint16, or `guide` is not uint8.
    ValueError
        If `costs` are empty, not 3-D or more than 2^31 - 1, D is above 32768, `guide` has another
        shape, a penalty is negative, `p1` is above `p2`, `contrast` is not above 0, `paths` is not
        4, 8 or 16, ``paths * (largest_cost + p2)`` is 65536 or more (the sums would overflow), or
        `max_bytes` is too small (the message says how many are needed).

    Notes
    -----
    All arithmetic is in integers, so the sums are the same on every device and kernel set.

    The result takes ``2 H W D`` bytes. The work takes about ``12 (H + W) D`` bytes on a CPU, and on
    a GPU up to 8 volumes of one byte per element (two bytes if `p2` is above 255). If `max_bytes`
    is smaller, the work is done in strips of rows that also read 64 rows of their neighbours. A
    path then begins there instead of at the border, so the sums differ a little. Costs that must be
    copied, because they are not contiguous or not on the GPU, take additional memory.

    References
    ----------
    .. [1] H. Hirschmueller, "Stereo processing by semiglobal matching and mutual information",
       IEEE PAMI 30(2), 2008, equations 13 and 14.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> costs = np.full((1, 3, 4), 9, np.uint8)
    >>> costs[0, 0, 2] = costs[0, 2, 2] = 0  # the pixel between them has no opinion
    >>> cvkern.aggregate_semi_global(costs, 2, 5, paths=4)[0, 1]
    array([46, 40, 36, 40], dtype=uint16)
    """
    costs = check_image(costs, ndim=(3,), name="costs", most=MAX_COSTS)
    dtype = library(costs).dtype(costs)
    if dtype not in (np.uint8, np.uint16):
        raise TypeError(f"costs must be uint8 or uint16, got {dtype}")
    height, width, depth = shape = tuple(costs.shape)
    check_depth(depth)
    p1, p2 = check_penalties(p1, p2)
    contrast = check_positive(contrast, "contrast")
    paths = check_paths(paths)
    if guide is not None:
        guide = check_image(guide, name="guide")
        check_dtype(guide, np.uint8, "guide")
        if tuple(guide.shape) != shape[:2]:
            raise ValueError(f"guide must have shape {shape[:2]}, got {tuple(guide.shape)}")
    if largest_cost is not None:
        largest_cost = check_integer(largest_cost, "largest_cost", 0, np.iinfo(dtype).max)
    rt = runtime(costs, guide)
    if largest_cost is None:
        largest_cost = 255 if dtype == np.uint8 else _largest(rt, costs)
    check_sums(paths, largest_cost, p2)

    def work(rows: int) -> int:
        return rt.stereo.paths.aggregation.aggregation_bytes(
            rt.device, rows, width, depth, paths, p2
        )

    strips = cut_strips(
        height, 2 * height * width * depth, work, max_bytes, f"costs of shape {shape}"
    )
    table = Penalties(p1, rt.constant(penalties(p1, p2, contrast)), p2)
    flat = rt.constant(np.zeros((1, 1), np.uint8))
    sums = rt.empty(shape, np.uint16)
    target = rt.adopt(sums, np.uint16)
    for strip in strips:
        seen = rt.adopt(strip.seen_of(costs), dtype)
        gray = flat if guide is None else rt.adopt(strip.seen_of(guide), np.uint8)
        kept = strip.kept_of(target)
        rt.stereo.paths.aggregation.aggregate(seen, gray, table, paths, strip.margin, kept)
    return rt.release(sums)


def check_paths(paths: int) -> int:
    """Return the checked number of paths."""
    if not isinstance(paths, (int, np.integer)) or int(paths) not in PATHS:
        raise ValueError(f"paths must be one of {PATHS}, got {paths!r}")
    return int(paths)


def check_penalties(p1: int, p2: int) -> tuple[int, int]:
    """Return the checked penalties of a path."""
    p1 = check_integer(p1, "p1", 0, 2**14)
    p2 = check_integer(p2, "p2", 0, 2**14)
    if p1 > p2:
        raise ValueError(f"p1 must be <= p2, got {p1} > {p2}")
    return p1, p2


def penalties(p1: int, p2: int, contrast: float) -> np.ndarray:
    """Return the penalty of a change by more than one for each difference of a guide's values."""
    table = np.floor(p2 * contrast / (contrast + np.arange(256)))
    return np.maximum(table, p1).astype(np.uint16)


def check_sums(paths: int, largest_cost: int, p2: int) -> None:
    """Refuse costs and penalties whose sums would overflow."""
    most = paths * (largest_cost + p2)
    if most > np.iinfo(np.uint16).max:
        raise ValueError(
            f"paths * (largest_cost + p2) must be < 65536, "
            f"got {paths} * ({largest_cost} + {p2}) = {most}"
        )


def _largest(rt: Runtime, costs: Any) -> int:
    """Return the largest cost of a uint16 volume."""
    most = rt.scratch("semi_global.largest", tuple(costs.shape[:2]), np.int32)
    rt.stereo.winners.largest(rt.adopt(costs, np.uint16), most)
    return int(rt.to_numpy(most).max())
