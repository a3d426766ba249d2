"""Phase unwrapping: an image of phases without jumps by whole turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._checks import check_image
from cvkern._runtime import refuse_capture, runtime

TURN = 2 * math.pi
MOST_TURNS = 2**30  # turns between neighbours: a phase in radians stays below this


def unwrap_phase(phase: Any, mask: Any = None) -> Any:
    """Remove the jumps by whole turns from an image of phases.

    Neighbours are joined in the order of their quality, the best first. Each pair is joined such
    that its phases differ by less than half a turn. Errors therefore stay in regions of low
    quality.

    Parameters
    ----------
    phase : array of shape (H, W)
        Phases in radians; any real dtype. NaN counts as masked out.
    mask : array of shape (H, W), optional
        Pixels to unwrap are not 0. Regions that do not touch are unwrapped separately.

    Returns
    -------
    array of shape (H, W), float32
        The phase plus whole turns; NaN where it is masked out. The first pixel of a region, in
        raster order, keeps its value.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If `phase` is empty or not 2-D, or `mask` has another shape.

    See Also
    --------
    decode_phase_shift : Phases of fringes; several frequencies need no unwrapping.

    Notes
    -----
    The cost of a pair is the wrapped difference of its phases, plus the mean of the two second
    differences over all eight neighbours [1]_. The pairs of a minimum spanning tree are joined.
    Second differences alone, as in [1]_ and scikit-image, keep fewer neighbours within half a turn.
    SciPy does the work on the host, in about 1 microsecond a pixel.

    References
    ----------
    .. [1] M. A. Herraez, D. R. Burton, M. J. Lalor and M. A. Gdeisat, "Fast two-dimensional
       phase-unwrapping algorithm based on sorting by reliability following a noncontinuous path",
       Applied Optics 41, 2002.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.unwrap_phase([[0.0, 2.0, -2.2, -0.2]]).round(2)
    array([[0.  , 2.  , 4.08, 6.08]], dtype=float32)
    """
    phase = check_image(phase, name="phase")
    if mask is not None:
        mask = check_image(mask, name="mask")
        if tuple(mask.shape) != tuple(phase.shape):
            raise ValueError(
                f"mask must have the shape of the phase, {tuple(phase.shape)}, "
                f"got {tuple(mask.shape)}"
            )
    refuse_capture("unwrap_phase")
    arrays = [phase] if mask is None else [phase, mask]
    rt = runtime(*arrays)
    values = rt.to_numpy(rt.adopt(phase))
    there = np.isfinite(values)
    if mask is not None:
        there &= rt.to_numpy(rt.adopt_mask(mask)) != 0
    return rt.give(_unwrapped(values, there))


def _unwrapped(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Unwrap the pixels of the mask `there`; NaN elsewhere."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    values = np.where(there, values, 0).astype(np.float64)
    flat, count = values.ravel(), values.size
    a, b = _pairs(there)
    bend = _bends(values, there).ravel()
    cost = np.abs(_wrapped(flat[b] - flat[a])) + (bend[a] + bend[b]) / 2
    rank = np.empty(len(cost))  # unique weights, above 0: equal costs keep the order of the pixels
    rank[np.argsort(cost, kind="stable")] = np.arange(1, len(cost) + 1)
    tree = minimum_spanning_tree(coo_array((rank, (a, b)), shape=(count, count)).tocsr()).tocoo()

    # An extra root is joined to the first pixel of each region, so that one walk visits all
    # regions.
    root = count
    first = _first_of_regions(tree.row, tree.col, there)
    rows = np.concatenate([tree.row, tree.col, np.full(len(first), root), first])
    columns = np.concatenate([tree.col, tree.row, first, np.full(len(first), root)])
    edges = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count + 1, count + 1)).tocsr()
    order, before = breadth_first_order(edges, root)
    order = order[1:]
    turns = np.zeros(count + 1, np.int64)
    inner = order[before[order] != root]
    between = np.rint((flat[before[inner]] - flat[inner]) / TURN)
    if not (np.abs(between) < MOST_TURNS).all():
        raise ValueError(f"phase must be in radians, got {np.abs(flat).max():g}")
    turns[inner] = between
    # Sum along the path to the root by pointer doubling.
    parent = np.full(count + 1, root)
    parent[order] = before[order]
    # Paths in the tree are shorter than `count`, and each round halves them: at most 31 rounds.
    while (parent != root).any():
        turns += np.where(parent == root, 0, turns[parent])
        parent = parent[parent]
    result = np.where(there.ravel(), flat + TURN * turns[:-1], np.nan)
    return result.reshape(values.shape).astype(np.float32)


def _pairs(there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels of all pairs of neighbours within the mask: pairs along rows first."""
    number = np.arange(there.size).reshape(there.shape)
    sides = []
    for axis in (1, 0):
        low = [slice(None)] * 2
        high = [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        both = there[tuple(low)] & there[tuple(high)]
        sides.append((number[tuple(low)][both], number[tuple(high)][both]))
    (a, b), (c, d) = sides
    return np.concatenate([a, c]), np.concatenate([b, d])


def _bends(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return second differences of the phase; a missing neighbour gives the largest value."""
    padded = np.pad(values, 1)
    known = np.pad(there, 1)
    height, width = values.shape
    total = np.zeros(values.shape)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        after = np.s_[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        ahead = np.s_[1 - dy : 1 - dy + height, 1 - dx : 1 - dx + width]
        bend = _wrapped(padded[after] - values) - _wrapped(values - padded[ahead])
        total += np.where(known[after] & known[ahead], bend, TURN) ** 2
    return np.sqrt(np.where(there, total, 0))


def _first_of_regions(rows: np.ndarray, columns: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return the first pixel, in raster order, of each connected region."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    shape = (there.size, there.size)
    labels = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), shape=shape))[1]
    pixels = np.flatnonzero(there)
    return pixels[np.unique(labels[pixels], return_index=True)[1]]


def _wrapped(difference: np.ndarray) -> np.ndarray:
    """Return the difference modulo whole turns, within half a turn."""
    return difference - TURN * np.rint(difference / TURN)
