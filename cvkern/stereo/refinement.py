"""Refinement of disparity maps. NaN marks a pixel without a disparity."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_dtype, check_image, check_integer, check_number
from cvkern._runtime import runtime

MAX_CONTRAST = 2**16  # keeps the sum of the weights of a window below 2^31


def left_right_check(disparity: Any, right: Any, *, tolerance: float = 1.0) -> Any:
    """Keep the disparities that both images of a pair agree on.

    Parameters
    ----------
    disparity : array of shape (H, W)
        Disparities d of the left image, whose pixel (y, x) is at (y, x - d) in the right one.
    right : array of shape (H, W)
        Disparities d of the right image, whose pixel (y, x) is at (y, x + d) in the left one.
    tolerance : float, default 1.0
        Largest difference between the two disparities of a point, in pixels.

    Returns
    -------
    array of shape (H, W), float32
        The disparity d where ``abs(d - right[y, x - floor(d + 0.5)]) <= tolerance``. NaN
        elsewhere, as in regions that only one camera sees, and where that pixel is outside the
        image.

    Raises
    ------
    TypeError
        If a map does not hold real numbers.
    ValueError
        If a map is empty or not 2-D, the shapes differ, or `tolerance` is negative or not finite.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.left_right_check([[0.0, 1.0, 1.0, 2.0]], [[1.0, 1.0, 0.0, 0.0]], tolerance=0.5)
    array([[nan,  1.,  1., nan]], dtype=float32)
    """
    disparity = check_image(disparity, name="disparity")
    right = check_image(right, name="right")
    shape = tuple(disparity.shape)
    if tuple(right.shape) != shape:
        raise ValueError(f"right must have shape {shape}, got {tuple(right.shape)}")
    tolerance = check_number(tolerance, "tolerance", low=0)
    rt = runtime(disparity, right)
    checked = rt.empty(shape)
    rt.stereo.refinement.agreement.left_right(
        rt.adopt(disparity), rt.adopt(right), 0, tolerance, rt.adopt(checked)
    )
    return rt.release(checked)


def remove_speckles(disparity: Any, min_size: int = 100, *, difference: float = 2.0) -> Any:
    """Remove small regions whose disparities differ from their surroundings.

    Parameters
    ----------
    disparity : array of shape (H, W)
        Pixels; NaN where the disparity is unknown.
    min_size : int, default 100
        Regions of fewer pixels are removed.
    difference : float, default 2.0
        Two pixels that share a side belong to one region if they differ by at most this.

    Returns
    -------
    array of shape (H, W), float32
        The map with NaN in place of small regions.

    Raises
    ------
    TypeError
        If `disparity` does not hold real numbers, or `min_size` is no integer.
    ValueError
        If `disparity` is empty or not 2-D, `min_size` is below 1, or `difference` is negative or
        not finite.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.remove_speckles([[3, 3, 9, 3, 3]], 2)
    array([[ 3.,  3., nan,  3.,  3.]], dtype=float32)
    """
    disparity = check_image(disparity, name="disparity")
    min_size = check_integer(min_size, "min_size", 1, 2**31 - 1)
    difference = check_number(difference, "difference", low=0)
    rt = runtime(disparity)
    kept = rt.empty(tuple(disparity.shape))
    rt.stereo.refinement.speckles.remove_speckles(
        rt.adopt(disparity), min_size, difference, rt.adopt(kept)
    )
    return rt.release(kept)


def fill_disparity(disparity: Any) -> Any:
    """Fill the gaps of a disparity map from the background side.

    A region that only the left camera sees belongs to the background. So a gap takes the smaller of
    the two disparities that bound it along its row.

    Parameters
    ----------
    disparity : array of shape (H, W)
        Pixels; NaN or infinite where the disparity is unknown.

    Returns
    -------
    array of shape (H, W), float32
        The map without gaps. A gap at the border takes the one disparity that bounds it. A row
        without any disparity is copied from the nearest row above that has one, or else below. The
        map is NaN only if no pixel has a disparity.

    Raises
    ------
    TypeError
        If `disparity` does not hold real numbers.
    ValueError
        If `disparity` is empty or not 2-D.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.fill_disparity([[2, np.nan, np.nan, 5, np.nan]])
    array([[2., 2., 2., 5., 5.]], dtype=float32)
    """
    disparity = check_image(disparity, name="disparity")
    rt = runtime(disparity)
    shape = tuple(disparity.shape)
    filled = rt.empty(shape)
    valid = rt.scratch("fill.valid", shape, np.uint8)
    rt.stereo.refinement.gaps.fill(rt.adopt(disparity), rt.adopt(filled), valid)
    return rt.release(filled)


def guided_median(disparity: Any, guide: Any, radius: int = 6, *, contrast: int = 40) -> Any:
    """Smooth a disparity map, and move its edges to those of an image.

    This is a weighted median along each row, and then down each column of the result. A pixel of
    the window has the weight ``max(1, contrast - g)``, where g is the difference between the
    guide's values there and in the middle. The median is the first value, in ascending order, at
    which the sum of the weights reaches half of the total.

    Parameters
    ----------
    disparity : array of shape (H, W)
        Pixels; NaN has no weight.
    guide : array of shape (H, W), uint8
        The left image. Outside, the nearest pixel of the map and of the image is repeated.
    radius : int, default 6
        Radius of the window, 0 to 15 pixels; 0 leaves the map unchanged.
    contrast : int, default 40
        Difference in the guide, plus one, that gives a pixel the smallest weight; 1 gives the plain
        median.

    Returns
    -------
    array of shape (H, W), float32
        NaN only where the whole window is NaN.

    Raises
    ------
    TypeError
        If `disparity` does not hold real numbers, `guide` is not uint8, or `radius` or `contrast`
        is no integer.
    ValueError
        If `disparity` is empty or not 2-D, `guide` has another shape, `radius` is not within 0 to
        15 or `contrast` not within 1 to 65536.

    Notes
    -----
    A two-dimensional window [1]_ takes many times as long. On photographs with ground truth, it was
    hardly better.

    References
    ----------
    .. [1] Z. Ma et al., "Constant time weighted median filtering for stereo matching and beyond",
       ICCV 2013.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> image = np.array([[10, 10, 10, 99, 99]], np.uint8)
    >>> cvkern.guided_median([[1, 1, 7, 7, 7]], image, 2)  # the object begins a pixel too soon
    array([[1., 1., 1., 7., 7.]], dtype=float32)
    """
    disparity = check_image(disparity, name="disparity")
    guide = check_image(guide, name="guide")
    check_dtype(guide, np.uint8, "guide")
    shape = tuple(disparity.shape)
    if tuple(guide.shape) != shape:
        raise ValueError(f"guide must have shape {shape}, got {tuple(guide.shape)}")
    rt = runtime(disparity, guide)
    radius = check_integer(radius, "radius", 0, rt.stereo.refinement.medians.max_radius())
    contrast = check_integer(contrast, "contrast", 1, MAX_CONTRAST)
    smooth = rt.empty(shape)
    rt.stereo.refinement.medians.guided_median(
        rt.adopt(disparity), rt.adopt(guide, np.uint8), radius, contrast, rt.adopt(smooth)
    )
    return rt.release(smooth)
