"""The generalised Hough transform: arbitrary shapes, rotated and scaled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import MAX_ELEMENTS, check_integer, check_number, check_photograph
from cvkern._runtime import runtime
from cvkern.hough.generalized._ballot import ballot_of, candidates, scene_of, voters_of
from cvkern.hough.generalized._poses import Judge, Model, Scene
from cvkern.hough.generalized.tables import SIGMA, RTable, check_table
from cvkern.kernels.codes.hough import Cells

CANDIDATES = 64  # poses that are judged, plus four for each shape to return


class Shapes(NamedTuple):
    """The poses at which a shape was found, in order of decreasing support."""

    position: Any
    """Row and column of the reference point, in pixels, (N, 2) float32."""
    rotation: Any
    """Radians from the column axis towards the row axis, clockwise on the screen, within -pi to pi,
    (N,) float32."""
    scale: Any
    """Size divided by the template's size, (N,) float32."""
    votes: Any
    """Votes in the four cells around the position, (N,) int32."""
    support: Any
    """Share of the template's boundary points with an edge in place, (N,) float32: at most about a
    pixel away, and with a direction that differs by at most 7 degrees."""


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
    """Find an arbitrary shape at any position, rotated and scaled, whole or partly hidden.

    For each rotation and scale, an edge point is taken as each boundary point with its direction,
    and votes for the position of the reference point. The poses with most votes are fitted to the
    edges by least squares. They are judged by their support: the share of the boundary that has an
    edge in place.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        Any real dtype; colour as in :func:`cvkern.canny`. With `orientation`, a mask (H, W) of the
        edges.
    table : RTable
        The result of :func:`r_table`, made with the same `sigma` and thresholds.
    rotations : int or sequence of float, optional
        The number of rotations over the full turn, or the rotations in radians. By default only 0.
    scales : sequence of float, optional
        Scales within 1/16 to 16; by default only 1.
    orientation : array of shape (H, W), optional
        Direction of the gradient at the pixels of the mask, in radians.
    sigma, low_threshold, high_threshold, use_quantiles
        As in :func:`cvkern.canny`, for derivatives of the Gaussian; ignored for a mask. By
        default the thresholds are those of :func:`cvkern.detect_circles`.
    orientation_tolerance : float, optional
        Largest angle, in radians, between the directions of an edge point and the boundary point
        that it is taken as. By default half the step between rotations, but within 0.5 to 3
        degrees, so that over the full turn each edge point meets each boundary point about once.
        The number of votes, and the time, are proportional to it.
    cell : {1, 2, 4, 8, 16}, default 4
        Side of a cell of the accumulator in pixels.
    max_entries : int, default 500
        Largest number of boundary points that vote, evenly chosen from the table, and at most
        65535 / cell^2. All boundary points take part in the fit and the support.
    threshold : float, default 0.25
        Smallest support in [0, 1], the share of the boundary that is found in place.
    num_peaks : int, optional
        Largest number of shapes to return. By default all that are found, which are at most 128.
    min_distance : float, optional
        Of shapes that are less than this apart, in pixels, only the best one is returned. By
        default half the mean distance of the boundary from the reference point.
    min_rotation : float, optional
        A shape near a better one is returned as well if their rotations differ by more than this,
        in radians. By default none is, because rotations differ by at most pi.
    min_ratio : float, default 256.0
        A shape near a better one is returned as well if their scales differ by more than this
        factor. By default none is, because no two scales differ by more than 256.
    max_bytes : int, default 268435456
        Memory for the accumulators that are filled at a time.

    Returns
    -------
    Shapes
        Named tuple of `position` (N, 2), `rotation` (N,), `scale` (N,), `votes` (N,) and `support`
        (N,), in order of decreasing support; `votes` are int32, the others float32. In an image
        without edges, N is 0.

    Raises
    ------
    TypeError
        If `image` or `orientation` do not hold real numbers, or an option is of a wrong type.
    ValueError
        If `image` is empty or of another shape, `table` has no entries or is not finite,
        `rotations` or `scales` are empty, not finite or out of range, `cell` is none of the sizes,
        `max_bytes` is too small for one rotation and scale, or another option is out of its range;
        as in :func:`r_table` for `orientation`; as in :func:`cvkern.canny`; and within
        :func:`cvkern.capture`, because the host chooses among the peaks.

    Notes
    -----
    Votes are integers, and the same on every device and kernel set. Ballard sorts directions into
    bins. Here each boundary point has a window of directions around its own, which rotates with it,
    and takes its votes from the edge points sorted by direction. So no direction is near the end of
    a bin.

    An edge point may vote several times in a cell, so votes only rank poses; use the support to
    decide whether a shape is present. Noise, blur and a change of scale rotate gradients: a whole
    shape in a real photograph may have a support of a half. Dense texture supports any shape to
    some degree.

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
    image = image if isinstance(image, Scene) else check_photograph(image)
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
    height, width = image.shape[:2]
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
    """Return the accumulator in which :func:`generalized_hough` searches for peaks.

    Parameters
    ----------
    image, table, rotations, scales, orientation, sigma, low_threshold, high_threshold, \
use_quantiles, orientation_tolerance, cell, max_entries
        As in :func:`generalized_hough`.

    Returns
    -------
    array of shape (R, S, I, J), int32
        Votes for each rotation, scale, row and column of cells: I is ceil(H / cell), J is
        ceil(W / cell). A vote counts at the pixel nearest to the reference point; pixel (y, x) is
        in cell (y // cell, x // cell).

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
    image = image if isinstance(image, Scene) else check_photograph(image)
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
    height, width = image.shape[:2]
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
