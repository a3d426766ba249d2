"""The colour of the light, from a photograph alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_numbers, check_beside, check_choice, check_image, check_number
from cvkern._order import floats_of
from cvkern._runtime import Runtime, runtime
from cvkern.color.spaces import apply_matrix
from cvkern.kernels.codes.color import SLOTS

MOST = 2**18  # pixels that estimates are made of; larger images are averaged by blocks
GREY_SHARE, EXTREME_SHARE, WHITE_RANK = 0.01, 0.035, 99.0
MOST_COLOUR = 1e12  # ratio of the largest part of a light to the least one
CONTRAST = 1e-4  # least local contrast of a grey pixel, as a share of the largest value


def estimate_illuminant(
    image: Any,
    method: str = "consensus",
    *,
    mask: Any = None,
    black: float = 0.0,
    white: float | None = None,
) -> np.ndarray:
    """Estimate the colour of the light that a scene is lit by.

    Parameters
    ----------
    image : array of shape (H, W, 3)
        Linear red, green and blue, any real dtype: a camera's raw values, not sRGB.
    method : str, default 'consensus'
        What is taken to be grey: 'grey_world' the mean [1]_, 'white_patch' the brightest percent of
        each channel, 'shades_of_grey' the mean of 6th powers [2]_, 'grey_edge' the mean of first
        derivatives, 'grey_edge_2' of squared second derivatives [3]_, 'bright_and_dark' the main
        axis of the brightest and darkest pixels [4]_, 'grayness_index' the pixels whose logarithms
        change alike in all channels [5]_. 'consensus' is the mean of the grayness index, counted
        twice, of grey edges and of the white patch.
    mask : array of shape (H, W), optional
        Where it is 0, pixels do not count, as those of a chart.
    black : float, default 0.0
        Value of no light, which is taken off.
    white : float, optional
        Value at which a channel is saturated; the largest of the image when omitted. Pixels above
        98 % of it do not count, nor do their neighbours where derivatives are taken.

    Returns
    -------
    (3,) float64
        Red, green and blue of the light, the largest of them 1. Equal on all devices. Of an image
        without any pixel that counts, (1, 1, 1).

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If shapes are not those above, the method is unknown, or `white` is not above `black`.

    See Also
    --------
    white_balance : Take the colour of the light out.

    Notes
    -----
    Kernels average images of more than 2^18 pixels by blocks, and leave out what does not count.
    The estimate itself is made on the host, of what is left.

    References
    ----------
    .. [1] G. Buchsbaum, "A spatial processor model for object colour perception", Journal of the
       Franklin Institute 310, 1980.
    .. [2] G. D. Finlayson and E. Trezzi, "Shades of gray and colour constancy", CIC 2004.
    .. [3] J. van de Weijer, T. Gevers and A. Gijsenij, "Edge-based color constancy", IEEE
       Transactions on Image Processing 16, 2007.
    .. [4] D. Cheng, D. K. Prasad and M. S. Brown, "Illuminant estimation for color constancy: why
       spatial-domain methods work and the role of the color distribution", JOSA A 31, 2014.
    .. [5] Y. Qian, J.-K. Kamarainen, J. Nikkanen and J. Matas, "On finding gray pixels", CVPR 2019.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.random.default_rng(0).random((60, 80, 1)) * [1.0, 0.8, 0.4]
    >>> cvkern.estimate_illuminant(scene).round(2)
    array([1. , 0.8, 0.4])
    """
    image = check_image(image, ndim=(3,))
    if image.shape[2] != 3:
        raise ValueError(f"image must have shape (H, W, 3), got {tuple(image.shape)}")
    check_choice(method, tuple(METHODS), "method")
    black = check_number(black, "black")
    mask = check_beside(mask, tuple(image.shape[:2]), "mask")
    rt = runtime(image)
    pixels = rt.adopt(image)
    if white is None:
        most = _peak(rt, pixels) - black
    else:
        most = check_number(white, "white") - black
        if most <= 0:
            raise ValueError(f"white must be above black, {black:g}, got {white:g}")
    if most <= 0:
        return np.ones(3)
    values, valid = _gathered(rt, pixels, mask, black, 1 / most)
    if not valid.any():
        return np.ones(3)
    light = METHODS[method](values, valid)
    return light / light.max()


def white_balance(image: Any, illuminant: Any) -> Any:
    """Divide an image by the colour of its light, so that what is grey looks grey.

    Parameters
    ----------
    image : array of shape (H, W, 3)
        Linear red, green and blue, any real dtype.
    illuminant : (red, green, blue)
        Colour of the light, as of `estimate_illuminant`; its scale does not count.

    Returns
    -------
    array of shape (H, W, 3), float32
        Red and blue are scaled, green is kept. Nothing is limited.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If the image is not of shape (H, W, 3), or the light not of three positive numbers.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.white_balance(np.array([[[2.0, 1.0, 0.5]]]), (2, 1, 0.5))
    array([[[1., 1., 1.]]], dtype=float32)
    """
    light = check_light(illuminant)
    image = check_image(image, ndim=(3,))
    return apply_matrix(image, np.diag(light[1] / light), "rgb", "rgb")


def check_light(illuminant: Any) -> np.ndarray:
    """Return red, green and blue of a light."""
    light = as_numbers(illuminant, "illuminant")
    if light.shape != (3,) or not (np.isfinite(light).all() and (light > 0).all()):
        raise ValueError(f"illuminant must be three positive numbers, got {light.tolist()}")
    if light.max() > MOST_COLOUR * light.min():
        raise ValueError(
            f"illuminant must have parts that differ by at most {MOST_COLOUR:g} times, "
            f"got {light.tolist()}"
        )
    return light


def _peak(rt: Runtime, pixels: Any) -> float:
    """Return the largest value of the finite pixels, or -inf."""
    keys = rt.scratch("constancy.keys", (SLOTS,), np.int64)
    rt.clear(keys)
    rt.color.constancy.peak(pixels.reshape((pixels.shape[0] * pixels.shape[1], 3)), keys)
    key = int(rt.to_numpy(keys).max())
    if not key:
        return -np.inf
    return float(floats_of(np.array([key - 2**32], np.int32))[0])


def _gathered(
    rt: Runtime, pixels: Any, mask: Any, black: float, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels on the host, averaged by blocks if they are many, and which count."""
    height, width = pixels.shape[:2]
    side = int(np.ceil(np.sqrt(height * width / MOST)))
    shape = max(1, height // side), max(1, width // side)
    values = rt.scratch("constancy.values", (*shape, 3), np.float64)
    valid = rt.scratch("constancy.valid", shape, np.uint8)
    marked = rt.scratch("constancy.none", (0, 0), np.uint8)
    if mask is not None:
        own = runtime(mask)
        host = np.asarray(own.to_numpy(own.adopt(mask, library(mask).dtype(mask))))
        marked = rt.send("constancy.mask", (host != 0).astype(np.uint8))
    rt.color.constancy.gather(pixels, marked, black, scale, side, values, valid)
    return np.array(rt.to_numpy(values)), np.array(rt.to_numpy(valid)) != 0


def _unit(light: np.ndarray) -> np.ndarray:
    light = np.maximum(light, 1e-12)
    return light / light.sum()


def _power(p: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda values, valid: _unit(np.mean(values[valid] ** p, axis=0) ** (1 / p))


def _white_patch(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    return _unit(np.percentile(values[valid], WHITE_RANK, axis=0))


def _inner(valid: np.ndarray) -> np.ndarray:
    """Return the pixels whose neighbours within three pixels all count, or all that do."""
    from scipy import ndimage

    inner = ndimage.binary_erosion(valid, iterations=3)
    return inner if inner.any() else valid


def _edges(order: int, p: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    def estimate(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
        from scipy import ndimage

        def derived(channel: np.ndarray, *orders: int) -> np.ndarray:
            each: Any = orders  # an order for each axis
            return ndimage.gaussian_filter(channel, 1.0, order=each)

        lengths = []
        for channel in np.moveaxis(values, 2, 0):
            if order == 1:
                found = derived(channel, 0, 1) ** 2 + derived(channel, 1, 0) ** 2
            else:
                found = derived(channel, 0, 2) ** 2 + derived(channel, 2, 0) ** 2
                found = found + 4 * derived(channel, 1, 1) ** 2
            lengths.append(np.sqrt(found)[_inner(valid)])
        means = np.array([np.mean(length**p) for length in lengths]) ** (1 / p)
        return _unit(means) if means.any() else _power(1)(values, valid)

    return estimate


def _bright_and_dark(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    pixels = values[valid]
    mean = pixels.mean(axis=0)
    along = pixels @ (mean / np.linalg.norm(mean))
    count = max(1, int(len(pixels) * EXTREME_SHARE))
    order = np.argsort(along, kind="stable")
    chosen = pixels[np.concatenate([order[:count], order[-count:]])]
    axis = np.linalg.eigh(chosen.T @ chosen)[1][:, -1]
    return _unit(np.abs(axis))


def _grayness(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    from scipy import ndimage

    channels = [ndimage.uniform_filter(c, 7) for c in np.moveaxis(values, 2, 0)]
    contrast = [np.abs(ndimage.gaussian_laplace(c, 1.0)) for c in channels]
    good = _inner(valid) & (np.min(contrast, axis=0) > CONTRAST)
    if not good.any():
        return _power(1)(values, valid)
    lit = [np.maximum(c, 0) + 1e-10 for c in channels]
    total = np.log(np.maximum(sum(channels), 0) + 1e-10)
    changes = [ndimage.gaussian_laplace(np.log(c) - total, 1.0) for c in (lit[0], lit[2])]
    grayness = ndimage.uniform_filter(np.hypot(*changes), 7)
    grayness[~good] = np.inf
    count = min(max(1, int(grayness.size * GREY_SHARE)), int(good.sum()))
    chosen = np.argsort(grayness, axis=None, kind="stable")[:count]
    return _unit(np.array([c.ravel()[chosen].mean() for c in channels]))


def _consensus(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    grey, edges = _grayness(values, valid), _edges(1, 1)(values, valid)
    return (2 * grey + edges + _white_patch(values, valid)) / 4


METHODS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "consensus": _consensus,
    "grey_world": _power(1),
    "white_patch": _white_patch,
    "shades_of_grey": _power(6),
    "grey_edge": _edges(1, 1),
    "grey_edge_2": _edges(2, 2),
    "bright_and_dark": _bright_and_dark,
    "grayness_index": _grayness,
}
