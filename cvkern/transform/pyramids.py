"""Gaussian and Laplacian pyramids."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._arrays import NUMPY
from cvkern._checks import check_integer, check_number, refuse_masks
from cvkern._runtime import runtime
from cvkern.filters.linear import gaussian
from cvkern.transform.resampling import check_pyramid, resample
from cvkern.transform.sampling import layout, shaped


def pyramid_gaussian(
    image: Any,
    max_layer: int = -1,
    downscale: float = 2,
    sigma: float | None = None,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
) -> list[Any]:
    """Return an image and its repeatedly smoothed and shrunk copies.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, C) or (C, H, W)
        Any real dtype.
    max_layer : int, default -1
        Number of smaller layers; -1 continues until the size does not change.
    downscale : float, default 2
        Ratio of the sizes of consecutive layers, above 1.
    sigma : float, optional
        Standard deviation of the Gaussian, in pixels; ``2 downscale / 6`` by default.
    mode, cval
        As in :func:`gaussian`.
    channel_axis : int, optional
        Axis of the channels, the first or the last; needed for 3-D images.

    Returns
    -------
    list of arrays, float32
        The image itself, then the smaller ones.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of a wrong rank, `max_layer` is below -1, `downscale` is not above
        1, `sigma` is negative, or `mode` is unknown.

    Notes
    -----
    The values of :func:`skimage.transform.pyramid_gaussian` with ``preserve_range=True``.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> [level.shape for level in cvkern.pyramid_gaussian(np.ones((5, 8)), 2)]
    [(5, 8), (3, 4), (2, 2)]
    """
    image, axis, layers, sigma = _check(image, max_layer, downscale, sigma, channel_axis)
    refuse_masks(mode=mode, cval=cval)
    levels = [_real(image)]
    # A level is smaller than the one before, or the loop ends.
    while len(levels) - 1 != layers:
        smooth = gaussian(levels[-1], sigma, mode=mode, cval=cval, channel_axis=channel_axis)
        smaller = _shrunk(smooth, axis, downscale)
        if tuple(smaller.shape) == tuple(levels[-1].shape):
            break
        levels.append(smaller)
    return levels


def pyramid_laplacian(
    image: Any,
    max_layer: int = -1,
    downscale: float = 2,
    sigma: float | None = None,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
) -> list[Any]:
    """Return the details that smoothing removes from an image and from its smaller copies.

    Parameters
    ----------
    image, downscale, sigma, mode, cval, channel_axis
        As in :func:`pyramid_gaussian`.
    max_layer : int, default -1
        Number of smaller layers; -1 continues until the larger side is one pixel.

    Returns
    -------
    list of arrays, float32
        Differences, the finest first.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        As in :func:`pyramid_gaussian`.

    Notes
    -----
    The values of :func:`skimage.transform.pyramid_laplacian` with ``preserve_range=True``: each
    layer is the difference of a smoothed and shrunk copy and the same smoothed once more.

    References
    ----------
    .. [1] P. Burt and E. Adelson, "The Laplacian pyramid as a compact image code", IEEE
       Transactions on Communications 31(4), 1983.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> [level.shape for level in cvkern.pyramid_laplacian(np.ones((4, 4)), 1)]
    [(4, 4), (2, 2)]
    """
    image, axis, layers, sigma = _check(image, max_layer, downscale, sigma, channel_axis)
    refuse_masks(mode=mode, cval=cval)
    if layers < 0:
        largest = max(layout(tuple(image.shape), axis)[1:3])
        layers = math.ceil(math.log(largest, downscale) - 1e-9)
    level, levels = _real(image), []
    for left in reversed(range(layers + 1)):
        smooth = gaussian(level, sigma, mode=mode, cval=cval, channel_axis=channel_axis)
        levels.append(_difference(level, smooth))
        level = _shrunk(smooth, axis, downscale) if left else level
    return levels


def _check(
    image: Any, max_layer: int, downscale: float, sigma: float | None, channel_axis: int | None
) -> tuple[Any, int | None, int, float]:
    image, axis = check_pyramid(image, channel_axis)
    layers = check_integer(max_layer, "max_layer", -1, 2**16)
    downscale = check_number(downscale, "downscale")
    if downscale <= 1:
        raise ValueError(f"downscale must be > 1, got {downscale:g}")
    sigma = 2 * downscale / 6 if sigma is None else check_number(sigma, "sigma", low=0)
    return image, axis, layers, sigma


def _real(image: Any) -> Any:
    """Return the image as float32, in memory of its own."""
    rt = runtime(image)
    if rt.library is NUMPY and rt.device == "cpu":
        floats = rt.empty(tuple(image.shape))
        with np.errstate(over="ignore"):
            np.copyto(floats, image, casting="unsafe")
        return floats
    return gaussian(image, 0.0, channel_axis=None if len(image.shape) == 2 else -1)


def _shrunk(image: Any, axis: int | None, downscale: float) -> Any:
    old = layout(tuple(image.shape), axis)
    sides = tuple(math.ceil(n / downscale) for n in old[1:3])
    rt = runtime(image)
    result = rt.empty(shaped(tuple(image.shape), sides, axis))
    new = layout(tuple(result.shape), axis)
    resample(rt, rt.adopt(image, shape=old), old, "linear", rt.adopt(result, shape=new), new)
    return rt.release(result)


def _difference(a: Any, b: Any) -> Any:
    rt = runtime(a)
    result = rt.empty(tuple(a.shape))
    flat = (math.prod(a.shape),)
    one, other, dst = (rt.adopt(x, shape=flat) for x in (a, b, result))
    rt.transform.pyramids.subtract(one, other, dst)
    return rt.release(result)
