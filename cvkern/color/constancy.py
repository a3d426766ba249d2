"""The colour of the light, from a photograph alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_numbers, check_beside, check_choice, check_number, check_rgb
from cvkern._order import floats_of
from cvkern._runtime import Runtime, runtime
from cvkern.color.spaces import apply_matrix
from cvkern.filters.linear import frozen_taps, gaussian_taps
from cvkern.kernels.codes.color import SLOTS
from cvkern.kernels.codes.filters import Border

MOST = 2**18  # pixels that estimates are made of; larger images are averaged by blocks
GREY_SHARE, EXTREME_SHARE, WHITE_RANK = 0.01, 0.035, 99.0
MOST_COLOUR = 1e12  # ratio of the largest part of a light to the least one
FLAT = 1e-6  # mean length of derivatives below which they are roundings, as a share of white
SQUARE = frozen_taps(np.full(7, 1 / 7))
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
        98 % of it do not count, nor do their neighbours where derivatives are taken. When omitted
        and all pixels are that bright, as in an image of one colour, all count.

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
    Kernels average images of more than 2^18 pixels by blocks, leave out what does not count, and
    make maps of edges and grayness of what is left, in float32. Means and ranks are taken on the
    host.

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
    image = check_rgb(image)
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
    scene = _gathered(rt, pixels, mask, black, 1 / most)
    if white is None and not scene.valid.any():
        scene = _gathered(rt, pixels, mask, black, 0.5 / most)
    if not scene.valid.any():
        return np.ones(3)
    light = METHODS[method](scene)
    return light / light.max()


def white_balance(image: Any, illuminant: Any) -> Any:
    """Divide an image by the colour of its light, so that grey surfaces look grey.

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
    image = check_rgb(image)
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
    return float(floats_of(np.array([key - 2**31], np.int32))[0])


class Scene:
    """The pixels that estimates are made of, averaged by blocks if they were many."""

    def __init__(self, rt: Runtime, values: Any, valid: Any) -> None:
        self.rt, self.values = rt, values
        self.shape = tuple(values.shape[:2])
        self.valid = rt.to_numpy(valid) != 0
        self._inner = rt.scratch("constancy.inner", self.shape, np.uint8)
        rt.color.constancy.inner(valid, self._inner)
        # A scene too small has no such pixels: then all that count serve.
        inner = rt.to_numpy(self._inner) != 0
        if not inner.any():
            self._inner, inner = valid, self.valid
        self.inner = inner

    @cached_property
    def pixels(self) -> np.ndarray:
        """(3, N) float64: the pixels that count, channel by channel."""
        return self.rt.to_numpy(self.values)[self.valid].T.astype(np.float64)

    def filtered(self, name: str, values: Any, down: np.ndarray, across: np.ndarray) -> Any:
        """Correlate the channels (H, W, C) of values down the rows, then along the columns."""
        height, width, channels = values.shape
        rows = (1, height, width * channels)
        out = self.rt.scratch(f"constancy.{name}", rows)
        self.rt.filters.linear.correlate_separable(
            values.reshape(rows), self.rt.constant(down), self.rt.constant(across),
            channels, Border.REFLECT, 0.0, out,
        )  # fmt: skip
        return out.reshape(tuple(values.shape))

    def derived(self, values: Any, name: str, down: int, across: int) -> Any:
        """Return derivatives of these orders of a Gaussian of 1 pixel."""
        return self.filtered(name, values, gaussian_taps(1.0, down), gaussian_taps(1.0, across))

    def curved(self, values: Any) -> tuple[Any, Any]:
        """Return second derivatives (N, C) of the channels, down the rows and along columns."""
        flat = (self.valid.size, values.shape[2])
        down = self.derived(values, "one", 2, 0).reshape(flat)
        return down, self.derived(values, "two", 0, 2).reshape(flat)

    def lively(self, means: Any, least: float) -> np.ndarray:
        """Return the inner pixels where all channels differ from their surroundings."""
        size = (self.valid.size,)
        good = self.rt.scratch("constancy.good", size, np.uint8)
        down, across = self.curved(means)
        self.rt.color.constancy.contrasts(down, across, self._inner.reshape(size), least, good)
        return self.rt.to_numpy(good) != 0


def _gathered(rt: Runtime, pixels: Any, mask: Any, black: float, scale: float) -> Scene:
    height, width = pixels.shape[:2]
    side = int(np.ceil(np.sqrt(height * width / MOST)))
    shape = max(1, height // side), max(1, width // side)
    values = rt.scratch("constancy.values", (*shape, 3))
    valid = rt.scratch("constancy.valid", shape, np.uint8)
    marked = rt.scratch("constancy.none", (0, 0), np.uint8)
    if mask is not None:
        own = runtime(mask)
        host = np.asarray(own.to_numpy(own.adopt(mask, library(mask).dtype(mask))))
        marked = rt.send("constancy.mask", (host != 0).astype(np.uint8))
    rt.color.constancy.gather(pixels, marked, black, scale, side, values, valid)
    return Scene(rt, values, valid)


def _unit(light: np.ndarray) -> np.ndarray:
    light = np.maximum(light, 1e-12)
    return light / light.sum()


def _power(p: float) -> Callable[[Scene], np.ndarray]:
    return lambda scene: _unit(np.mean(scene.pixels**p, axis=1) ** (1 / p))


def _white_patch(scene: Scene) -> np.ndarray:
    return _unit(np.percentile(scene.pixels, WHITE_RANK, axis=1))


def _edges(order: int, p: float) -> Callable[[Scene], np.ndarray]:
    def estimate(scene: Scene) -> np.ndarray:
        values, rt = scene.values, scene.rt
        flat = (values.size,)
        orders = ((order, 0), (0, order), (1, 1))[: order + 1]
        parts = [
            scene.derived(values, name, *each).reshape(flat)
            for name, each in zip(("one", "two", "three"), orders, strict=False)
        ]
        found = rt.scratch("constancy.lengths", flat)
        factor = 4.0 if order == 2 else 0.0
        rt.color.constancy.lengths(parts[0], parts[1], parts[-1], factor, found)
        lengths = rt.to_numpy(found).reshape(*scene.shape, 3)[scene.inner]
        means = np.mean(lengths.T.astype(np.float64) ** p, axis=1) ** (1 / p)
        return _unit(means) if means.max() > FLAT else _power(1)(scene)

    return estimate


def _bright_and_dark(scene: Scene) -> np.ndarray:
    pixels = scene.pixels.T
    mean = pixels.mean(axis=0)
    along = pixels @ (mean / np.linalg.norm(mean))
    count = max(1, int(len(pixels) * EXTREME_SHARE))
    order = np.argsort(along, kind="stable")
    chosen = pixels[np.concatenate([order[:count], order[-count:]])]
    axis = np.linalg.eigh(chosen.T @ chosen)[1][:, -1]
    return _unit(np.abs(axis))


def _grayness(scene: Scene) -> np.ndarray:
    rt, size = scene.rt, scene.valid.size
    means = scene.filtered("means", scene.values, SQUARE, SQUARE)
    good = scene.lively(means, CONTRAST)
    if not good.any():
        return _power(1)(scene)
    logs = rt.scratch("constancy.logs", (size, 2))
    rt.color.constancy.logarithms(means.reshape((size, 3)), logs)
    down, across = scene.curved(logs.reshape((*scene.shape, 2)))
    changes = rt.scratch("constancy.changes", (size,))
    rt.color.constancy.sizes(down, across, changes)
    near = scene.filtered("near", changes.reshape((*scene.shape, 1)), SQUARE, SQUARE)
    places = np.flatnonzero(good)
    grayness = rt.to_numpy(near).ravel()[places]
    count = min(max(1, int(size * GREY_SHARE)), len(places))
    # The first of equal ones count.
    last = np.partition(grayness, count - 1)[count - 1]
    below = np.flatnonzero(grayness < last)
    equal = np.flatnonzero(grayness == last)[: count - len(below)]
    chosen = places[np.concatenate([below, equal])]
    light = rt.to_numpy(means).reshape(size, 3)[chosen]
    return _unit(light.astype(np.float64).mean(axis=0))


def _consensus(scene: Scene) -> np.ndarray:
    grey, edges = _grayness(scene), _edges(1, 1)(scene)
    return (2 * grey + edges + _white_patch(scene)) / 4


METHODS: dict[str, Callable[[Scene], np.ndarray]] = {
    "consensus": _consensus,
    "grey_world": _power(1),
    "white_patch": _white_patch,
    "shades_of_grey": _power(6),
    "grey_edge": _edges(1, 1),
    "grey_edge_2": _edges(2, 2),
    "bright_and_dark": _bright_and_dark,
    "grayness_index": _grayness,
}
