"""Exposures of one scene: the response of a camera, and the radiance of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import FLOAT32_MAX, as_numbers, check_choice, check_image, check_positive
from cvkern._runtime import runtime

METHODS = ("debevec", "robertson")
SAMPLES = 2**17  # pixels that a response is made of
VALUES = 2**21  # values of all exposures at these pixels, which bounds the time of many exposures
SHORTEST = 2.0**-126  # seconds: the least normal number of float32
PAIRED = 8  # exposures up to which all pairs of them are counted one by one
BLOCK = 4096  # pixels that are counted together of more exposures
CODES = 256
ENDS = 4  # codes at either end of the scale that may be clipped
# Weight of how the curve bends over log2 of its codes, beside the mean weight of one.
SMOOTH = 3000.0
OUTLYING = 3.0  # standard deviations at which a value counts half
ROUNDS, STILL = 40, 1e-4  # at most so many of Robertson's, until the curve moves less


def estimate_response(images: Any, seconds: Any, method: str = "debevec") -> np.ndarray:
    """Estimate how a camera turns exposure into 8-bit values, from several exposures of a scene.

    Parameters
    ----------
    images : array of shape (K, H, W) or (K, H, W, C), uint8
        Exposures of a scene at rest, registered. NumPy also takes a sequence of images.
    seconds : sequence of K floats
        Their times, above 0, not all equal. Any order.
    method : {'debevec', 'robertson'}, default 'debevec'
        By least squares on log exposure with a smooth curve [1]_, or by turns between radiance and
        curve on exposure [2]_.

    Returns
    -------
    (256, C) float64
        log2 of the exposure (radiance times seconds) of each value, 0 at the value 128; C is 1 for
        grey images. It never falls.

    Raises
    ------
    TypeError
        If `images` are not uint8, or `seconds` not numbers.
    ValueError
        If there are fewer than two images, shapes differ, times are not as above, or longer
        exposures are darker, as with times in another order than the images.

    See Also
    --------
    merge_exposures : The radiance of the scene.

    Notes
    -----
    All unknown radiances are eliminated, so that up to 2^17 pixels take part, on a grid, and 2^21
    values of all exposures. Values near 0 and 255, which may be clipped, count less, by the square
    of their distance. Two further fits weigh them by the inverse of the error that a step of one
    makes after the one before, the last one also by how well a pixel's values agree. The curve is
    made on the host. Robertson's turns begin with a line and converge slowly: after 40 of them, the
    curve of a gamma is still off by a tenth of a stop, where least squares is off by a hundredth.
    Images that are black or white throughout tell nothing: their curve is 0.

    References
    ----------
    .. [1] P. E. Debevec and J. Malik, "Recovering high dynamic range radiance maps from
       photographs", SIGGRAPH 1997.
    .. [2] M. A. Robertson, S. Borman and R. L. Stevenson, "Estimation-theoretic approach to dynamic
       range enhancement using multiple exposures", Journal of Electronic Imaging 12, 2003.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> light = np.linspace(0.01, 1, 4096).reshape(64, 64)
    >>> seconds = [0.25, 0.5, 1.0]
    >>> images = [np.uint8(255 * (light * t) ** 0.5) for t in seconds]
    >>> curve = cvkern.estimate_response(images, seconds)
    >>> (curve[200] - curve[100]).round(1)  # twice the value is four times the light
    array([2.])
    """
    images, shape = stacked(images)
    if library(images).dtype(images) != np.uint8:
        raise TypeError(f"images must be uint8, got {library(images).dtype(images)}")
    times = _times(seconds, shape[0])
    if times.min() == times.max():
        raise ValueError(f"seconds must not all be equal, got {times[0]:g}")
    check_choice(method, METHODS, "method")
    rt = runtime(images)
    step = max(1, int(np.sqrt(shape[1] * shape[2] / min(SAMPLES, VALUES / len(times)))))
    host = np.asarray(rt.to_numpy(rt.adopt(images, np.uint8, shape)))[:, ::step, ::step]
    check_order(times, host)
    fit = _debevec if method == "debevec" else _robertson
    curves = [fit(channel.reshape(len(times), -1), times) for channel in np.moveaxis(host, 3, 0)]
    return np.stack(curves, axis=1)


def merge_exposures(
    images: Any, seconds: Any, response: Any = None, *, deghost: float | None = None
) -> Any:
    """Merge exposures of a scene to its radiance.

    Parameters
    ----------
    images : array of shape (K, H, W) or (K, H, W, C)
        Exposures, registered: uint8, or any real dtype for linear values, such as those of
        `demosaic`. NumPy also takes a sequence of images.
    seconds : sequence of K floats
        Their times, above 0, in any order.
    response : array of shape (256, C) or 'linear', optional
        log2 exposure of each 8-bit value, as `estimate_response` returns it. When omitted, that is
        estimated from uint8 images, and others are linear.
    deghost : float, optional
        Stops by which an exposure may differ from the one that is best exposed over the image; one
        that differs more, because something moved there, does not count at that pixel.

    Returns
    -------
    array of shape (H, W) or (H, W, C), float32
        Radiance, at the scale of the response: 1 gives the value 128 in one second. For linear
        values, their value in one second.

    Raises
    ------
    TypeError
        If `images` do not hold real numbers, or `seconds` or `response` are not numbers.
    ValueError
        If shapes or lengths do not agree, times are not above 0, `response` is for images that
        are not uint8, or it is estimated and longer exposures are darker.

    Notes
    -----
    The weighted mean of log exposures. Each value weighs as the inverse of the variance that a step
    of one makes there, ``1 / g'^2`` of the response g, times its distance from the nearer end of
    the scale, as flare and clipping grow towards these [1]_; within an eighth of either end, it
    weighs less. Linear values weigh as the squared time. Where no exposure counts, the shortest
    tells what is too bright and the longest what is too dark. It agrees between devices to
    rounding.

    References
    ----------
    .. [1] P. E. Debevec and J. Malik, "Recovering high dynamic range radiance maps from
       photographs", SIGGRAPH 1997.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> images = np.array([[[0.25, 0.4]], [[0.5, 0.8]]])
    >>> cvkern.merge_exposures(images, [1, 2])
    array([[0.25, 0.4 ]], dtype=float32)
    """
    images, shape = stacked(images)
    times = _times(seconds, shape[0])
    dtype = library(images).dtype(images)
    linear = dtype != np.uint8 or (isinstance(response, str) and response == "linear")
    if response is None and not linear:
        curves = estimate_response(images, seconds) if len(np.unique(times)) > 1 else None
        linear = curves is None
    elif not linear:
        curves = as_numbers(response, "response")
        if curves.shape != (CODES, shape[3]):
            raise ValueError(f"response must have shape {(CODES, shape[3])}, got {curves.shape}")
    elif response is not None and not isinstance(response, str):
        raise ValueError(f"response must be of uint8 images, got {dtype}")
    stops = -1.0 if deghost is None else check_positive(deghost, "deghost")
    rt = runtime(images)
    count, channels = shape[1] * shape[2], shape[3]
    flat = (len(times), count, channels)
    carried = dtype if dtype in (np.dtype(np.uint8), np.dtype(np.uint16)) else np.dtype(np.float32)
    values = rt.adopt(images, carried, flat)
    result = rt.empty(tuple(images.shape[1:]))
    out = rt.adopt(result, np.float32, (count, channels))
    order = np.argsort(times, kind="stable")
    reference = int(order[len(order) // 2])
    if linear:
        most = 255.0 if dtype == np.uint8 else _most(rt, images, carried)
        tables = np.zeros((1, channels, 2), np.float32)
        stops = 2.0 ** min(stops, 127.0) if stops > 0 else stops  # a factor, without logarithms
    else:
        most, tables = 0.0, _tables(curves)  # pyright: ignore[reportPossiblyUnboundVariable, reportArgumentType]
    rt.raw.exposures.merge(
        values, rt.constant(np.ascontiguousarray(tables)),
        rt.constant(np.stack([times, np.log2(times)], 1).astype(np.float32)),
        rt.constant(order.astype(np.int32)), reference, stops, most, out,
    )  # fmt: skip
    return rt.release(result)


def stacked(images: Any) -> tuple[Any, tuple[int, ...]]:
    """Return the images as one array, and its shape as (K, H, W, C)."""
    if isinstance(images, (list, tuple)):
        if any(not isinstance(image, np.ndarray) for image in images):
            raise TypeError("images must be one array of shape (K, H, W), or NumPy arrays")
        if len({image.shape for image in images}) > 1:
            shapes = sorted({image.shape for image in images})
            raise ValueError(f"images must have one shape, got {', '.join(map(str, shapes))}")
        images = np.stack(images) if images else np.zeros((0, 0, 0))
    images = check_image(images, ndim=(3, 4), name="images")
    if images.shape[0] < 2:
        raise ValueError(f"images must be at least 2, got {images.shape[0]}")
    return images, tuple(images.shape) if len(images.shape) == 4 else (*images.shape, 1)


def _times(seconds: Any, count: int) -> np.ndarray:
    times = as_numbers(seconds, "seconds")
    if times.shape != (count,):
        raise ValueError(f"seconds must be {count}, one an image, got shape {times.shape}")
    if not (np.isfinite(times).all() and (times > 0).all()):
        raise ValueError(f"seconds must be above 0, got {times.tolist()}")
    if not (times.min() >= SHORTEST and times.max() <= FLOAT32_MAX):
        raise ValueError(
            f"seconds must be in [{SHORTEST:.1e}, {FLOAT32_MAX:.1e}], got {times.tolist()}"
        )
    return times


def check_order(times: np.ndarray, images: Sequence[np.ndarray] | np.ndarray) -> None:
    """Refuse times with which longer exposures are darker more often than brighter."""
    means = np.array([np.mean(image) for image in images])[np.argsort(times, kind="stable")]
    if np.sum(np.diff(means) < 0) > np.sum(np.diff(means) > 0):
        raise ValueError(
            "seconds must be in the order of the images: longer exposures are darker with "
            f"{', '.join(f'{time:g}' for time in times)}"
        )


def _most(rt: Any, images: Any, carried: np.dtype) -> float:
    """Return the value at which linear images are saturated: their largest."""
    host = np.asarray(rt.to_numpy(rt.adopt(images, carried)))
    most = float(np.fmax.reduce(host, axis=None, initial=0.0))  # NaN does not count
    return most if most > 0 else 1.0


def _centre(codes: np.ndarray) -> np.ndarray:
    """Return the distance of codes from the ends of the scale, 0 to 1."""
    near = np.minimum(codes, CODES - 1 - codes) - (ENDS - 1)
    return near.clip(0) / (CODES / 2 - ENDS)


def _debevec(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Fit the curve three times: then values also weigh by the last one, and by how far off it."""
    z, logs = values.astype(np.int64), np.log2(times)
    curve = _fitted(z, logs, (_centre(np.arange(CODES)) ** 2)[z])
    share = np.sqrt(_precision(curve[:, None])[:, 0])
    curve = _fitted(z, logs, share[z])
    share = np.sqrt(_precision(curve[:, None])[:, 0])
    return _fitted(z, logs, share[z] * _trust(z, logs, curve, share))


def _trust(z: np.ndarray, logs: np.ndarray, curve: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return Cauchy's weight of each value: less, the further its pixel's others say it is off.

    What moved, is not aligned, or lost its colour in a JPEG file would else bend the curve.
    """
    w, light = share[z], curve[z] - logs[:, None]
    mean = (w * light).sum(axis=0) / np.maximum(w.sum(axis=0), 1e-12)
    off = np.abs(light - mean) * w
    among = off[(w > 1e-3 * w.max()) & ((w > 0).sum(axis=0) > 1)]
    scale = 1.4826 * float(np.median(among)) if among.size else 0.0
    return 1 / (1 + (off / max(OUTLYING * scale, 1e-9)) ** 2)


def _fitted(z: np.ndarray, logs: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Minimise ``sum w (g(z) - log2 E - log2 t)^2``, and how g bends over log2 z.

    Second differences of g are those of a line over ``u = log2(z + 1/2)``, which a power of z is,
    and what is left of them: only that is held small.
    """
    total = weights.sum(axis=0)
    z, w, total = z[:, total > 0], weights[:, total > 0], total[total > 0]
    mean = (w * logs[:, None]).sum(axis=0) / total
    matrix, right = np.zeros((CODES, CODES)), np.zeros(CODES)
    for i, a in enumerate(z):
        matrix[np.diag_indices(CODES)] += np.bincount(a, w[i], CODES)
        right += np.bincount(a, w[i] * (logs[i] - mean), CODES)
    matrix -= _shared(z, w, total)
    scale = max(float(np.trace(matrix)) / CODES, 1e-12)
    u = np.log2(np.arange(CODES) + 0.5)
    straight = np.diff(u, 2) / (u[2:] - u[:-2])
    first = np.eye(CODES)[2:] - np.eye(CODES)[:-2]
    second = np.diff(np.eye(CODES), 2, axis=0) - straight[:, None] * first
    bend = _centre(np.arange(1, CODES - 1)) + 0.02
    matrix = matrix / scale + SMOOTH * (second.T * bend**2) @ second
    matrix[CODES // 2, CODES // 2] += 1
    curve = np.linalg.solve(matrix + 1e-9 * np.eye(CODES), right / scale)
    return _rising(curve)


def _shared(z: np.ndarray, w: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Return the weight that each pair of codes shares at the pixels which have both."""
    found = np.zeros((CODES, CODES))
    if len(z) <= PAIRED:
        for i, a in enumerate(z):
            for j, b in enumerate(z):
                counted = np.bincount(a * CODES + b, w[i] * w[j] / total, CODES**2)
                found += counted.reshape(CODES, CODES)
        return found
    for first in range(0, z.shape[1], BLOCK):
        part = slice(first, first + BLOCK)
        size = z[:, part].shape[1]
        cells = z[:, part] + CODES * np.arange(size)
        of_codes = np.bincount(cells.ravel(), w[:, part].ravel(), size * CODES)
        of_codes = of_codes.reshape(size, CODES)
        found += of_codes.T @ (of_codes / total[part, None])
    return found


def _robertson(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Find radiance from the curve and the curve from radiance, in turns.

    Long exposures weigh more, by the square of their time: a small weight of their clipped values
    would outweigh the others, so these have none.
    """
    codes = np.arange(CODES)
    away = 1 - _centre(codes)
    weight = np.where(away < 1, np.exp(-4 * away**2), 0)
    z, t = values.astype(np.int64), times[:, None]
    z = z[:, weight[z].any(axis=0)]
    w = weight[z]
    curve = (codes + 0.5) / (CODES / 2)
    held = np.bincount(z.ravel(), minlength=CODES)
    seen = np.flatnonzero((held > 0) & (weight > 0))
    for _ in range(ROUNDS if seen.size else 0):
        light = (w * t * curve[z]).sum(axis=0) / (w * t * t).sum(axis=0)
        sums = np.bincount(z.ravel(), (t * light).ravel(), CODES)
        new = np.interp(codes, seen, sums[seen] / held[seen])
        new = new / max(new[CODES // 2], 1e-12)
        moved = np.abs(new - curve).max()
        curve = new
        if moved < STILL:
            break
    return _rising(np.log2(np.maximum(curve, 1e-6)))


def _rising(curve: np.ndarray) -> np.ndarray:
    """Make a curve rise, from its middle, 0, both ways: few values tell its ends."""
    middle = CODES // 2
    curve = curve - curve[middle]
    upper = np.maximum.accumulate(curve[middle:].clip(0))
    lower = np.minimum.accumulate(curve[middle::-1].clip(None, 0))[::-1]
    return np.concatenate([lower[:-1], upper])


def _precision(curves: np.ndarray) -> np.ndarray:
    """Return the weight of each code, (256, C): less within an eighth of either end."""
    slope = np.maximum(np.gradient(curves, axis=0), 1e-3)
    window = np.clip(_centre(np.arange(CODES)) * 8, 0, 1)[:, None] ** 2
    weights = window / slope**2
    return weights / weights.max(axis=0)


def _tables(curves: np.ndarray) -> np.ndarray:
    """Return log2 exposure and weight of each code and channel, (256, C, 2)."""
    weights = _precision(curves) * _centre(np.arange(CODES))[:, None]
    return np.stack([curves, weights], axis=2).astype(np.float32)
