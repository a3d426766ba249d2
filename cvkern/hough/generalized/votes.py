"""The generalised Hough transform: shapes of any form, turned and scaled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import MAX_ELEMENTS, check_image, check_integer, check_number
from cvkern._runtime import runtime
from cvkern.hough.generalized._ballot import ballot_of, candidates, scene_of, voters_of
from cvkern.hough.generalized._poses import Judge, Model
from cvkern.hough.generalized.tables import SIGMA, RTable, check_table
from cvkern.kernels.codes.hough import Cells

CANDIDATES = 64  # poses that are judged, and four more for each that is asked for


class Shapes(NamedTuple):
    """Where a shape was found, the best supported first."""

    position: Any
    """Row and column of the reference point, in pixels, (N, 2) float32."""
    rotation: Any
    """In radians from the axis of columns towards that of rows, clockwise as a picture is seen,
    within -pi to pi, (N,) float32."""
    scale: Any
    """Size over the template's, (N,) float32."""
    votes: Any
    """Votes that the four cells around the position got, (N,) int32."""
    support: Any
    """Share of the template's boundary that has an edge in place, (N,) float32: about a pixel away
    at most, and turned by at most 7 degrees."""


def generalized_hough(
    image: Any,
    table: RTable,
    *,
    rotations: Any = None,
    scales: Any = None,
    orientation: Any = None,
    sigma: float = SIGMA,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    use_quantiles: bool = False,
    orientation_tolerance: float | None = None,
    cell: int = 4,
    max_entries: int = 500,
    threshold: float = 0.25,
    num_peaks: int | None = None,
    min_distance: float | None = None,
    min_rotation: float = math.pi,
    min_ratio: float = 256.0,
    max_bytes: int = 2**28,
) -> Shapes:
    """Find a shape of any form, wherever it is, turned and scaled, whole or partly hidden.

    Each edge point votes, for each rotation and scale, at the places where the reference point
    would be if it were one of the boundary points of its direction. Where most votes meet, the
    pose is fitted to the edges by least squares, and judged by how much of the boundary they have.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype. With `orientation` a mask of the edges.
    table : RTable
        Of :func:`r_table`, made with the same `sigma` and thresholds.
    rotations : int or sequence of float, optional
        How many, over the full turn, or which, in radians. By default 0 alone.
    scales : sequence of float, optional
        Within 1/16 to 16; by default 1 alone.
    orientation : array of shape (H, W), optional
        Direction of the gradient at the pixels of the mask, in radians.
    sigma, low_threshold, high_threshold, use_quantiles
        As in :func:`cvkern.canny`, for derivatives of the Gaussian; without meaning for a mask. By
        default the thresholds are those of :func:`cvkern.detect_circles`.
    orientation_tolerance : float, optional
        How far, in radians, the direction of an edge point may be off that of the boundary point
        it votes as. By default half the step between rotations, but within 0.5 to 3 degrees, so
        that over the full turn each edge point meets each boundary point about once. The votes,
        and the time, are in proportion to it.
    cell : {1, 2, 4, 8, 16}, default 4
        Side of a cell of the accumulator in pixels.
    max_entries : int, default 500
        Boundary points that vote, evenly taken from those of the table; all judge. At most
        65535 / cell^2 do.
    threshold : float, default 0.25
        Least support, the share of the boundary that is found in place, in [0, 1].
    num_peaks : int, optional
        Return at most so many. Without, as many as are found, which are at most 128.
    min_distance : float, optional
        Of shapes less than this apart, in pixels, the best one is returned. By default half the
        mean distance of the boundary from the reference point.
    min_rotation : float, optional
        Return those as well that are turned against a better one by more than this, in radians.
        By default none is: no turn is more than pi.
    min_ratio : float, default 256.0
        Return those as well whose scale is larger or smaller than that of a better one by more
        than this factor. By default none is: no two scales differ by as much.
    max_bytes : int, default 268435456
        Memory of the accumulators that are filled at a time.

    Returns
    -------
    Shapes
        Named tuple of `position` (N, 2), `rotation` (N,), `scale` (N,), `votes` (N,) int32 and
        `support` (N,), the best supported first; float32 but for the votes. None is found in an
        image without edges.

    Raises
    ------
    TypeError
        If `image` or `orientation` do not hold real numbers, or an option is of a wrong type.
    ValueError
        If `image` is empty or not 2-D, `table` has no entries or is not finite, `rotations` or
        `scales` are empty, not finite or out of range, `cell` is no such size, `max_bytes` is less
        than one rotation and scale takes; another option is out of its range; as in
        :func:`r_table` for `orientation`; as :func:`cvkern.canny`. Within :func:`cvkern.capture`,
        as the host chooses among the peaks.

    Notes
    -----
    Votes are integers, and the same on every device and kernel set. Where Ballard has bins, each
    boundary point has a window of directions round its own, turned with it: it takes its votes from
    the edge points sorted by direction. So no direction is near the end of a bin.

    An edge point may vote several times in a cell, so that votes rank poses; support says how sure
    one can be. Noise, blur and a change of scale turn gradients: of a whole shape in a real
    photograph, half may be supported. Dense texture supports any shape to some degree.

    References
    ----------
    .. [1] D. H. Ballard, "Generalizing the Hough transform to detect arbitrary shapes", Pattern
       Recognition 13(2), 1981.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.zeros((60, 80))
    >>> scene[20:45, 30:40] = 1
    >>> scene[35:45, 40:55] = 1
    >>> table = cvkern.r_table(scene[12:53, 22:63])
    >>> found = cvkern.generalized_hough(np.rot90(scene), table, rotations=4, num_peaks=1)
    >>> np.degrees(found.rotation).round()
    array([-90.], dtype=float32)
    """
    image = check_image(image)
    options = sigma, low_threshold, high_threshold, use_quantiles
    table = check_table(table)
    threshold = check_number(threshold, "threshold", low=0)
    min_rotation = check_number(min_rotation, "min_rotation", low=0)
    min_ratio = check_number(min_ratio, "min_ratio", low=1)
    limit = 128 if num_peaks is None else check_integer(num_peaks, "num_peaks", 1, 10**6)
    if min_distance is None:
        min_distance = 0.5 * float(np.hypot(*table.vectors.T).mean())
    min_distance = check_number(min_distance, "min_distance", low=0)
    ballot = ballot_of(
        table.vectors,
        table.orientation,
        rotations,
        scales,
        orientation_tolerance,
        cell,
        max_entries,
    )
    height, width = image.shape
    batch = ballot.batch(height, width, check_integer(max_bytes, "max_bytes", 1, 2**62))
    rt = runtime(image)
    scene = scene_of(image, orientation, options, "image")
    poses, votes = candidates(rt, scene, ballot, batch, CANDIDATES + 4 * limit)
    support = np.empty(0)
    if len(poses):
        judge = Judge(scene, Model(table.vectors.astype(float), table.orientation.astype(float)))
        apart_by = min_distance, min_rotation, min_ratio
        poses, support, which = judge.best(poses, threshold, limit, apart_by)
        votes = votes[which]
    results = poses[:, :2], poses[:, 2], poses[:, 3], votes, support
    dtypes = np.float32, np.float32, np.float32, np.int32, np.float32
    return Shapes(*(rt.give(a.astype(d)) for a, d in zip(results, dtypes, strict=True)))


def generalized_hough_votes(
    image: Any,
    table: RTable,
    *,
    rotations: Any = None,
    scales: Any = None,
    orientation: Any = None,
    sigma: float = SIGMA,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    use_quantiles: bool = False,
    orientation_tolerance: float | None = None,
    cell: int = 4,
    max_entries: int = 500,
) -> Any:
    """Return the accumulator that :func:`generalized_hough` looks for peaks in.

    Parameters
    ----------
    image, table, rotations, scales, orientation, sigma, low_threshold, high_threshold, \
use_quantiles, orientation_tolerance, cell, max_entries
        As in :func:`generalized_hough`.

    Returns
    -------
    array of shape (R, S, I, J), int32
        Votes for each rotation, scale, row and column of cells: I is ceil(H / cell), J
        ceil(W / cell). A vote falls at the pixel that is nearest to the reference point, and
        pixel (y, x) is in cell (y // cell, x // cell).

    Raises
    ------
    TypeError, ValueError
        As :func:`generalized_hough`; and if the accumulator would have more than 2^29 elements.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.zeros((60, 80))
    >>> scene[20:45, 30:40] = 1
    >>> votes = cvkern.generalized_hough_votes(scene, cvkern.r_table(scene), rotations=2)
    >>> votes.shape
    (2, 1, 15, 20)
    """
    image = check_image(image)
    options = sigma, low_threshold, high_threshold, use_quantiles
    table = check_table(table)
    ballot = ballot_of(
        table.vectors,
        table.orientation,
        rotations,
        scales,
        orientation_tolerance,
        cell,
        max_entries,
    )
    height, width = image.shape
    rows, columns = ballot.cells(height, width)
    shape = (len(ballot.turns), len(ballot.scales), rows, columns)
    if math.prod(shape) > MAX_ELEMENTS:
        raise ValueError(
            f"accumulator must have at most {MAX_ELEMENTS} elements, "
            f"got shape {shape}: {4 * math.prod(shape)} bytes"
        )
    rt = runtime(image)
    scene = scene_of(image, orientation, options, "image")
    votes = rt.empty(shape, np.int32)
    rt.hough.generalized.votes.accumulate(
        voters_of(rt, scene),
        ballot.entries(rt),
        ballot.slices(rt, np.s_[:], np.s_[:]),
        ballot.tolerance,
        Cells(height, width, ballot.shift),
        rt.adopt(votes, np.int32),
    )
    return rt.release(votes)
