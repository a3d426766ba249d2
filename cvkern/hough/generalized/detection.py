"""The shape of one picture, found in another."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_photograph
from cvkern.hough.generalized.tables import SIGMA, r_table
from cvkern.hough.generalized.votes import generalized_hough


def detect_shape(
    template: Any,
    scene: Any,
    *,
    reference: tuple[float, float] | None = None,
    rotations: Any = 360,
    scales: Any = None,
    num_peaks: int | None = 1,
    threshold: float = 0.25,
    sigma: float = SIGMA,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    use_quantiles: bool = False,
    batch_axis: int | None = None,
    **options: Any,
) -> Any:
    """Find the shape of one picture in another, by :func:`r_table` and :func:`generalized_hough`.

    Parameters
    ----------
    template, scene : arrays of shape (H, W) or (H, W, C) with C in 3, 4
        Any real dtype; the scene may be a stack of them. Colour is read as in :func:`cvkern.canny`.
    reference
        As in :func:`r_table`.
    rotations : int or sequence of float, default 360
        As in :func:`generalized_hough`.
    scales : sequence of float, optional
        By default 17 scales from 0.8 to 1.6.
    num_peaks : int, optional
        Largest number of shapes to return, 1 by default; None for all.
    threshold : float, default 0.25
        Smallest share of the boundary that must be found in place.
    sigma, low_threshold, high_threshold, use_quantiles
        As in :func:`r_table`, for both pictures.
    batch_axis : {0}, optional
        Axis of the scenes in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each scene, because their lengths differ.
    **options
        The other options of :func:`generalized_hough`, except `orientation`.

    Returns
    -------
    Shapes, or list of them
        As :func:`generalized_hough`; of length 0 if the shape is not found.

    Raises
    ------
    TypeError, ValueError
        As :func:`r_table` and :func:`generalized_hough`.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.zeros((60, 80))
    >>> scene[20:45, 30:40] = 1
    >>> scene[35:45, 40:55] = 1
    >>> cvkern.detect_shape(scene[12:53, 22:63], scene).position.round(1)
    array([[32., 42.]], dtype=float32)
    """
    if "orientation" in options:
        raise TypeError("detect_shape takes pictures, got orientation: use generalized_hough")
    scene = check_photograph(scene, "scene", batch_axis)
    edges = {
        "sigma": sigma,
        "low_threshold": low_threshold,
        "high_threshold": high_threshold,
        "use_quantiles": use_quantiles,
    }
    table = r_table(template, reference=reference, **edges)
    search = {
        "rotations": rotations,
        "scales": np.linspace(0.8, 1.6, 17) if scales is None else scales,
        "num_peaks": num_peaks,
        "threshold": threshold,
        **edges,
        **options,
    }
    if batch_axis is None:
        return generalized_hough(scene, table, **search)
    return [generalized_hough(scene[n], table, **search) for n in range(scene.shape[0])]
