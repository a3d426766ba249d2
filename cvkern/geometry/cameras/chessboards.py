"""Chessboards in photographs: the inner corners, in order, to a fraction of a pixel."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_integer, check_photograph, check_rows_columns
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern._stacks import one_by_one
from cvkern.filters.linear import gaussian_taps
from cvkern.geometry.cameras._chessboard_grid import Saddles, area, describe, found_board, grids
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.geometry import EDGE_ENTRIES, EDGE_REACH

SIGMA = 1.5  # pixels of the smaller picture: it takes the noise away and leaves squares of 7 pixels
COARSE = 1100  # pixels along the longer side of the smallest picture that is looked at
DISTANCE = 2  # pixels to either side in which a saddle has the largest response
FAINTEST = 0.01  # response of a corner, as a share of the strongest: its contrast is a tenth
MOST_CANDIDATES = 6000
BLUR = 1.0  # pixels of the smaller picture: where the fit of a corner begins
MOST_MOVE = 0.35  # share of the distance to the neighbours that a corner may be moved by the fit
MOST_CORNERS = 1000  # along a side


def detect_chessboard(image: Any, shape: tuple[int, int], *, batch_axis: int | None = None) -> Any:
    """Find the inner corners of a chessboard in a photograph.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, 3) or (H, W, 4), or a stack of them
        A photograph of any real dtype. Colours become grey as in :func:`cvkern.images.luma`.
    shape : (int, int)
        Rows and columns of inner corners, where four squares meet: (6, 9) for a board of 7 x 10
        squares. Each at least 2. A board with other numbers is not found.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each image.

    Returns
    -------
    array of shape (rows * columns, 2), float64, or None, or list of them
        Row and column in the image, row by row of the board. None if no complete board of this
        shape is visible. Among several boards the largest is returned.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or has a wrong rank, or `shape` is not two integers of at least 2.

    See Also
    --------
    calibrate_camera : Calibrate a camera from the corners in several photographs.

    Notes
    -----
    Rows and columns of the board have the same orientation as those of an image, so a board seen
    from the front is never mirrored. If `rows + columns` is odd, the colours distinguish a board
    from the same board turned by 180 degrees: the square outside the first corner, at the corner of
    the board, is dark. Otherwise both look the same, and the first corner is the one from which the
    rows run to the right, or downwards if they are upright. On a board with as many rows as
    columns, the first corner is the one from which the rows run most nearly to the right, among the
    corners with a dark outer square if there are any.

    Corners are saddles of the smoothed picture, joined with neighbours along the edges. A model of
    two crossing blurred edges under a light gradient is then fitted to each corner, by least
    squares over the pixels up to 0.7 of the distance to the neighbours.

    References
    ----------
    .. [1] A. Duda and U. Frese, "Accurate detection and localization of checkerboard corners for
       calibration", BMVC 2018.
    .. [2] A. Geiger, F. Moosmann, O. Car and B. Schuster, "Automatic camera and range sensor
       calibration using a single shot", ICRA 2012.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> board = np.kron(np.indices((4, 5)).sum(axis=0) % 2, np.ones((20, 20))) * 255
    >>> corners = cvkern.detect_chessboard(np.pad(board, 20, constant_values=255), (3, 4))
    >>> corners[:2].round(1)
    array([[39.5, 39.5],
           [39.5, 59.5]])
    """
    if batch_axis is not None:
        return one_by_one(detect_chessboard, locals())
    image = check_photograph(image)
    sides = tuple(image.shape)
    rows, columns = check_rows_columns(shape, "corners")
    rows = check_integer(rows, "shape", 2, MOST_CORNERS)
    columns = check_integer(columns, "shape", 2, MOST_CORNERS)
    refuse_capture("detect_chessboard")
    rt = runtime(image)
    byte = library(image).dtype(image) == np.uint8
    src = rt.adopt(image, np.uint8 if byte else np.float32, (*sides, 1)[:3])
    for step in _steps(sides[0], sides[1]):
        found = _found(rt, src, step, (rows, columns))
        if found is not None:
            return rt.give(found)
    return None


def _steps(height: int, width: int) -> list[int]:
    """Return by how much pictures are made smaller: first the smallest, then finer ones.

    Noise and blur hide a large board in finer pictures, where a smaller one may show beside it.
    """
    step = 2
    # The step doubles.
    while 2 * max(height, width) > COARSE * step:
        step *= 2
    steps = [step >> n for n in range(step.bit_length())]
    return [step for step in steps if min(height, width) >= 8 * step]


def _found(rt: Runtime, src: Any, step: int, shape: tuple[int, int]) -> np.ndarray | None:
    """Return the corners of a board that shows in a picture `step` times as small."""
    saddles, smooth = _saddles(rt, src, step)
    boards = [found_board(grid, saddles.places, smooth, shape) for grid in grids(saddles, smooth)]
    there = [board for board in boards if board is not None]
    return _refined(rt, src, step, max(there, key=area)) if there else None


def _saddles(rt: Runtime, src: Any, step: int) -> tuple[Saddles, np.ndarray]:
    """Return the saddles of a smooth picture `step` times as small, and that picture."""
    height, width = src.shape[0] // step, src.shape[1] // step
    small, smooth, response = (
        rt.scratch(f"chessboards.{name}", (1, height, width))
        for name in ("small", "smooth", "response")
    )
    flat = [a.reshape((height, width)) for a in (small, smooth, response)]
    mask = rt.scratch("chessboards.mask", (height, width), np.uint8)
    rt.geometry.cameras.chessboards.shrink(src, flat[0])
    taps = rt.constant(gaussian_taps(SIGMA))
    rt.filters.linear.correlate_separable(small, taps, taps, 1, Border.REFLECT, 0.0, smooth)
    rt.geometry.cameras.chessboards.saddles(flat[1], flat[2])
    strengths = rt.to_numpy(flat[2])
    threshold = FAINTEST * float(strengths.max())
    rt.features.corners.mark_maxima(flat[2], DISTANCE, threshold, 1, mask)
    points = np.argwhere(rt.to_numpy(mask))
    if len(points) > MOST_CANDIDATES:
        order = np.argsort(-strengths[points[:, 0], points[:, 1]], kind="stable")
        points = points[np.sort(order[:MOST_CANDIDATES])]
    picture = rt.to_numpy(flat[1])
    return describe(picture, points), picture


@lru_cache
def edge_table() -> np.ndarray:
    """Return erf(t / sqrt(2)) and its slope for t from 0 to EDGE_REACH."""
    t = np.linspace(0, EDGE_REACH, EDGE_ENTRIES)
    values = [math.erf(x / math.sqrt(2)) for x in t]
    table = np.stack((values, math.sqrt(2 / math.pi) * np.exp(-t * t / 2)), axis=1)
    return table.astype(np.float32)


def _refined(rt: Runtime, src: Any, step: int, board: np.ndarray) -> np.ndarray:
    """Return row and column of the corners (rows, columns, 2) of a small picture, x and y."""
    there = board * step + (step - 1) / 2
    starts = np.concatenate(
        (there[..., ::-1], _slopes(there, 1)[..., ::-1], _slopes(there, 0)[..., ::-1]), axis=2
    ).reshape(-1, 6)
    starts = np.column_stack((starts, np.full(len(starts), BLUR * step)))
    places = rt.scratch("chessboards.places", (len(starts), 5), np.float64)
    given = rt.send("chessboards.starts", starts.astype(np.float32))
    rt.geometry.cameras.chessboards.refine(src, rt.constant(edge_table()), given, places)
    fitted = rt.to_numpy(places)[:, :2]
    reach = np.minimum(*(np.hypot(starts[:, 2 * n], starts[:, 2 * n + 1]) for n in (1, 2)))
    with np.errstate(invalid="ignore"):
        right = np.hypot(*(fitted - starts[:, :2]).T) < MOST_MOVE * reach
    return np.where(right[:, None], fitted, starts[:, :2])


def _slopes(board: np.ndarray, axis: int) -> np.ndarray:
    """Return the way from each corner to the next along an axis, the mean of both sides."""
    return np.gradient(board, axis=axis)
