"""Matching costs of a rectified pair."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    check_axes,
    check_code,
    check_colors,
    check_disparities,
    check_image,
    check_integer,
    check_pair,
    refuse_masks,
)
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.stereo import MAX_COSTS, Cost

MAX_SIDE = 1023  # largest side of a window, pixels
WORD = 64  # most bits of a census

_LARGEST = {Cost.SAD: 255, Cost.SSD: 255**2, Cost.BIRCHFIELD_TOMASI: 255, Cost.ZNCC: 255**2}


def stereo_cost(
    left: Any,
    right: Any,
    disparities: tuple[int, int],
    *,
    cost: str = "census",
    window: int | tuple[int, int] | None = None,
    neighborhood: int | tuple[int, int] = (7, 9),
    spacing: int = 1,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
) -> Any:
    """Compute the cost of matching each pixel with each candidate pixel of the other image.

    The pixel (y, x) of the left image is compared with (y, x - d) of the right one. Outside the
    image, the nearest pixel is repeated.

    Parameters
    ----------
    left, right : array of shape (H, W) or (H, W, C), or stacks of them
        A rectified pair. uint8 is compared in integers, any other real dtype in float32.
    disparities : (int, int)
        The first disparity d, and the one after the last, as in :class:`range`; both may be
        negative.
    cost : str, default 'census'
        The measure that is summed over the window and over the channels:

        - 'sad': absolute differences.
        - 'ssd': squared differences.
        - 'birchfield_tomasi': the smallest absolute difference between the pixel of one image and
          the values of the other image within half a pixel of its match, for either image [1]_.
          For uint8, interpolated values are rounded down.
        - 'census': the number of neighbours that are darker than the pixel in one image but not
          in the other [2]_.
        - 'census_symmetric': the same, but each neighbour in the first half of the neighbourhood,
          in raster order, is compared with its mirror image about the pixel [3]_.

        The measure 'zncc' is 1 minus the zero-mean normalised cross-correlation of the windows,
        where each channel has its own mean: 0 for equal windows, 2 for opposite ones, and 1 if one
        of the two is constant.
    window : int or (int, int), optional
        Odd height and width of the window, in pixels; 1 to 1023. By default 1 for a census and 9
        for the others.
    neighborhood : int or (int, int), default (7, 9)
        Odd height and width of the neighbourhood of a census, 1 to 65, with at most 64
        comparisons.
    spacing : int, default 1
        Distance of the neighbours of a census, in pixels; 1 to 16.
    channel_axis : int, optional
        Axis of the channels; by default the last of (H, W, 3 or 4), and of a stack with four axes.
    batch_axis : {0}, optional
        Axis of the pairs in two stacks, (N, H, W) or with channels.

    Returns
    -------
    array of shape (H, W, D), or (N, H, W, D) of stacks
        ``costs[y, x, k]`` is the cost of the disparity ``disparities[0] + k``. For uint8 images,
        and for a census of any images, the dtype is uint8 or uint16 if it holds every possible
        cost; otherwise float32. 'zncc' is float32.

    Raises
    ------
    TypeError
        If an image does not hold real numbers, or `disparities` are not two integers, or a side
        or `spacing` is no integer.
    ValueError
        If the images are empty, of another rank or of different shapes; if `disparities` are
        empty, as large as the image's width on either side, more than 32768, or make more than
        2^31 - 1 costs (the message says how many bytes these would take); if a side is even or out
        of range, the neighbourhood has no comparison or more than 64, `cost` is unknown, or the
        integer sums could reach 2^31.

    Notes
    -----
    The time does not grow with the area of the window. Integer costs have running sums, down the
    columns and along the rows; float32 costs are summed down and along separately. Every bit is
    the same on every device and kernel set, except for ZNCC and the measure of Birchfield and
    Tomasi near values that are not finite.

    References
    ----------
    .. [1] S. Birchfield and C. Tomasi, "A pixel dissimilarity measure that is insensitive to image
       sampling", IEEE PAMI 20(4), 1998.
    .. [2] R. Zabih and J. Woodfill, "Non-parametric local transforms for computing visual
       correspondence", ECCV 1994.
    .. [3] R. Spangenberg, T. Langner and R. Rojas, "Weighted semi-global matching and
       center-symmetric census transform for robust driver assistance", CAIP 2013.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> left = np.array([[10, 20, 90, 40, 50]], np.uint8)
    >>> right = np.array([[20, 90, 40, 50, 60]], np.uint8)
    >>> cvkern.stereo_cost(left, right, (0, 3), cost="sad", window=1)[0, 2]
    array([50,  0, 70], dtype=uint8)
    """
    ranks = (2, 3) if batch_axis is None else (3, 4)
    left = check_image(left, ndim=ranks, name="left")
    right = check_image(right, ndim=ranks, name="right")
    if tuple(left.shape) != tuple(right.shape):
        raise ValueError(
            f"right must have the shape of left, {tuple(left.shape)}, got {tuple(right.shape)}"
        )
    one_shape, stack = tuple(left.shape), ()
    if batch_axis is None:
        axis = check_colors(one_shape, channel_axis)
    else:
        last = -1 if channel_axis is None and len(one_shape) == 4 else channel_axis
        axis = check_axes(one_shape, last, batch_axis)
        stack, one_shape = one_shape[:1], one_shape[1:]
    sizes = [n for i, n in enumerate(one_shape) if i != axis]
    height, width, channels = shape = (*sizes, 1 if axis is None else one_shape[axis])
    first, stop = check_disparities(disparities, width)
    code = check_code(cost, Cost, "cost")
    census = code in (Cost.CENSUS, Cost.CENSUS_SYMMETRIC)
    radii = check_sides(window if window is not None else 1 if census else 9, "window", MAX_SIDE)
    around, bits = (0, 0), 0
    refuse_masks(neighborhood=neighborhood, spacing=spacing)
    if census:
        around = check_sides(neighborhood, "neighborhood", WORD + 1)
        spacing = check_integer(spacing, "spacing", 1, 16)
        bits = _census_bits(around, code)
    libraries = library(left), library(right)
    given = [lib.dtype(image) for lib, image in zip(libraries, (left, right), strict=True)]
    dtype = np.dtype(np.uint8 if all(d == np.uint8 for d in given) else np.float32)
    area = math.prod(2 * radius + 1 for radius in radii)
    most = (bits if census else _LARGEST[code]) * channels * area
    integral = census or dtype == np.uint8
    if integral and most >= 2**31:
        raise ValueError(f"window must keep the sums of integers below 2^31, got up to {most}")
    result = _result_dtype(most) if integral and code != Cost.ZNCC else np.dtype(np.float32)
    volume = (*stack, height, width, stop - first)
    if math.prod(volume) > MAX_COSTS:
        size = " x ".join(map(str, volume))
        needed = math.prod(volume) * result.itemsize
        raise ValueError(
            f"disparities must make at most {MAX_COSTS} costs, got {size} of {needed} bytes"
        )
    rt = runtime(left, right)
    one, other = (
        rt.adopt(
            image if axis in (None, 2) else lib.last(image, axis + len(stack)),
            dtype,
            (*stack, *shape),
        )
        for lib, image in zip(libraries, (left, right), strict=True)
    )
    costs = rt.empty(volume, result)
    target = rt.adopt(costs, result)
    measure = _Measure(code, first, radii, around, spacing, bits)
    if stack:
        for n in range(stack[0]):
            _fill(rt, measure, one[n], other[n], target[n], result)
    else:
        _fill(rt, measure, one, other, target, result)
    return rt.release(costs)


class _Measure(NamedTuple):
    """The checked options of :func:`stereo_cost`."""

    code: Cost
    first: int
    radii: tuple[int, int]
    around: tuple[int, int]
    spacing: int
    bits: int


def _fill(
    rt: Runtime, measure: _Measure, one: Any, other: Any, target: Any, dtype: np.dtype
) -> None:
    """Fill the costs of one pair of kernel arrays (H, W, C)."""
    code, first, radii, around, spacing, bits = measure
    if code == Cost.ZNCC:
        rt.stereo.costs.correlation.correlation(one, other, first, *radii, target)
    elif code not in (Cost.CENSUS, Cost.CENSUS_SYMMETRIC):
        rt.stereo.costs.windows.window_costs(one, other, first, code, 1, *radii, target)
    else:
        symmetric = code == Cost.CENSUS_SYMMETRIC
        one = census_words(rt, "stereo_cost.left", one, around, spacing, symmetric)
        other = census_words(rt, "stereo_cost.right", other, around, spacing, symmetric)
        if radii == (0, 0) and dtype == np.uint8:
            rt.stereo.costs.census.hamming(one, other, first, target)
        else:
            octets = -(-bits // 8)
            rt.stereo.costs.windows.window_costs(
                one, other, first, Cost.CENSUS, octets, *radii, target
            )


def census_words(
    rt: Runtime, name: str, image: Any, radii: tuple[int, int], spacing: int, symmetric: bool
) -> Any:
    """Return the census of a kernel array (H, W, C), in scratch memory of this name."""
    words = rt.scratch(name, tuple(image.shape), np.uint64)
    rt.stereo.costs.census.census(image, *radii, spacing, symmetric, words)
    return words


def check_sides(value: Any, name: str, most: int) -> tuple[int, int]:
    """Check that sides are odd; return half of each, rounded down."""
    sides = [check_integer(side, name, 1, most) for side in check_pair(value, name)]
    for side in sides:
        if side % 2 == 0:
            raise ValueError(f"{name} must have odd sides, got {side}")
    return sides[0] // 2, sides[1] // 2


def _census_bits(radii: tuple[int, int], code: Cost) -> int:
    """Return the number of comparisons of a census."""
    bits = math.prod(2 * radius + 1 for radius in radii) - 1
    bits //= 2 if code == Cost.CENSUS_SYMMETRIC else 1
    if not 1 <= bits <= WORD:
        raise ValueError(f"neighborhood must have 1 to {WORD} comparisons, got {bits}")
    return bits


def _result_dtype(most: int) -> np.dtype:
    """Return the smallest dtype that holds costs up to `most`."""
    return np.dtype(np.uint8 if most < 2**8 else np.uint16 if most < 2**16 else np.float32)
