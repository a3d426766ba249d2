"""The place of a sample and the weights of its neighbours, as in scipy.ndimage, in Warp.

The place q of a sample is first mapped into the image by the border's rule. A spline of order 0, 1
or 3 then weighs 1, 2 or 4 pixels along each axis by ``B(q - k)``, where B is the B-spline of that
order [M. Unser, IEEE Signal Processing Magazine 16(6), 1999]. Weights are in float64.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.transform import FARTHEST, OUTSIDE
from cvkern.kernels.warp._borders import border_index

AWAY = wp.constant(OUTSIDE)
FAR = wp.constant(FARTHEST)
BARELY = wp.constant(1e-15)
HALF = wp.constant(0.5)


@wp.func
def mapped(x: wp.float64, n: int, border: int) -> wp.vec2d:
    """Map a coordinate as scipy.ndimage does; also return the derivative: 1, -1, or 0."""
    none = wp.float64(0.0)
    one = wp.float64(1.0)
    if not (wp.abs(x) < wp.float64(FAR)):
        return wp.vec2d(wp.float64(AWAY), none)
    last = wp.float64(n - 1)
    if x >= none and x <= last:
        return wp.vec2d(x, one)
    if border == int(Border.CONSTANT):
        return wp.vec2d(wp.float64(AWAY), none)
    if border == int(Border.NEAREST):
        return wp.vec2d(wp.clamp(x, none, last), none)
    if n == 1:
        return wp.vec2d(none, none)
    if border == int(Border.WRAP):  # the first and the last pixel are one
        if x < none:
            return wp.vec2d(x + last * (wp.floor(-x / last) + one), one)
        return wp.vec2d(x - last * wp.floor(x / last), one)
    size = wp.float64(n)
    if border == int(Border.MIRROR):
        period = last + last
        if x < none:
            y = period * wp.floor(-x / period) + x
            if y <= -last:
                return wp.vec2d(y + period, one)
            return wp.vec2d(-y, -one)
        y = x - period * wp.floor(x / period)
        if y >= size:
            return wp.vec2d(period - y, -one)
        return wp.vec2d(y, one)
    period = size + size
    if x < none:
        y = x
        if x < -period:
            y = period * wp.floor(-x / period) + x
        if y < -size:
            return wp.vec2d(y + period, one)
        if y > -wp.float64(BARELY):
            return wp.vec2d(wp.float64(BARELY) - one, -one)
        return wp.vec2d(-y - one, -one)
    y = x - period * wp.floor(x / period)
    if y >= size:
        return wp.vec2d(period - y - one, -one)
    return wp.vec2d(y, one)


@wp.func
def tap_index(i: int, n: int, border: int) -> int:
    """Return the pixel that stands for pixel `i` of the spline: mirrored unless told otherwise."""
    if border == int(Border.REFLECT) or border == int(Border.NEAREST):
        return border_index(i, n, border)
    return border_index(i, n, int(Border.MIRROR))


@lru_cache
def taps(order: int) -> tuple[Any, Any, Any, Any, Any]:
    """Return, for a spline of `order`, vector types and functions of a mapped coordinate.

    They are: the vector of weights, the vector of indices, the indices, the weights and the
    derivatives of the weights by the coordinate.
    """
    count = order + 1
    weights_t = wp.types.vector(count, wp.float32)
    indices_t = wp.types.vector(count, wp.int32)

    @wp.func
    def indices(x: wp.float64, n: int, border: int) -> indices_t:
        if wp.static(order == 0):
            first = int(wp.floor(x + wp.float64(HALF)))
        elif wp.static(order == 1):
            first = int(wp.floor(x))
        else:
            first = int(wp.floor(x)) - 1
        found = indices_t()
        for t in range(wp.static(count)):
            found[t] = tap_index(first + t, n, border)
        return found

    @wp.func
    def weights(x: wp.float64) -> weights_t:
        found = weights_t()
        f = wp.float32(x - wp.floor(x))
        g = 1.0 - f
        if wp.static(order == 0):
            found[0] = 1.0
        elif wp.static(order == 1):
            found[0] = g
            found[1] = f
        else:
            found[0] = g * g * g / 6.0
            found[1] = (4.0 - 6.0 * (f * f) + 3.0 * (f * f * f)) / 6.0
            found[2] = (4.0 - 6.0 * (g * g) + 3.0 * (g * g * g)) / 6.0
            found[3] = f * f * f / 6.0
        return found

    @wp.func
    def slopes(x: wp.float64) -> weights_t:
        found = weights_t()
        f = wp.float32(x - wp.floor(x))
        g = 1.0 - f
        if wp.static(order == 1):
            found[0] = -1.0
            found[1] = 1.0
        elif wp.static(order == 3):
            found[0] = -0.5 * (g * g)
            found[1] = 1.5 * (f * f) - 2.0 * f
            found[2] = 2.0 * g - 1.5 * (g * g)
            found[3] = 0.5 * (f * f)
        return found

    return weights_t, indices_t, indices, weights, slopes


@lru_cache
def stored(result: Any) -> Any:
    """Return the function that converts a float to an element of `result`.

    A byte holds it rounded and cut off, and 0 for NaN.
    """

    @wp.func
    def store(v: float) -> result:
        if wp.static(result is wp.uint8):
            if v > 0.0:
                return result(int(wp.min(v, 255.0) + 0.5))
            return result(0)
        return result(v)

    return store


@lru_cache
def writer(scalar: Any, result: Any, order: int) -> Any:
    """Return the function that samples an image of `scalar` at mapped coordinates.

    It writes one pixel of all planes and channels, `cval` where a coordinate is outside.
    """
    _, _, indices, weights, _ = taps(order)
    sample = sampler(scalar, order)
    store = stored(result)

    @wp.func
    def write(
        src: wp.array4d[scalar],  # (P, H, W, C)
        y: wp.float64,
        x: wp.float64,
        border: int,
        cval: float,
        i: int,
        j: int,
        # outputs
        dst: wp.array4d[result],  # (P, H', W', C)
    ):
        if y == wp.float64(AWAY) or x == wp.float64(AWAY):
            outside = store(cval)
            for p in range(dst.shape[0]):
                for c in range(dst.shape[3]):
                    dst[p, i, j, c] = outside
        else:
            rows = indices(y, src.shape[1], border)
            columns = indices(x, src.shape[2], border)
            down = weights(y)
            along = weights(x)
            for p in range(dst.shape[0]):
                for c in range(dst.shape[3]):
                    dst[p, i, j, c] = store(sample(src, p, c, rows, columns, down, along))

    return write


@lru_cache
def sampler(scalar: Any, order: int) -> Any:
    """Return the function that weighs the pixels of one channel of an image of `scalar`."""
    weights_t, indices_t, *_ = taps(order)
    count = order + 1

    @wp.func
    def sample(
        src: wp.array4d[scalar],
        p: int,
        c: int,
        rows: indices_t,
        columns: indices_t,
        down: weights_t,
        along: weights_t,
    ) -> float:
        if wp.static(order == 0):
            return float(src[p, rows[0], columns[0], c])
        total = float(0.0)
        for i in range(wp.static(count)):
            line = float(0.0)
            for j in range(wp.static(count)):
                line += along[j] * float(src[p, rows[i], columns[j], c])
            total += down[i] * line
        return total

    return sample
