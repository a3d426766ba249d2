"""Linear samples of bytes as bytes, through a homography, in Warp.

A place is rounded to 2^-23 of a pixel, and the four weights are integers whose sum is 2^23: so the
result differs from exact arithmetic at the rounded place only by the last bit of the weights, and
no order of the sums can change it.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.transform import MIDDLE, PLACE_BITS, START, WIDEST

from ._taps import AWAY, mapped, stored, taps

BITS = wp.constant(PLACE_BITS)
STEPS = wp.constant(2.0**PLACE_BITS)
ONE, HALF = wp.constant(2**PLACE_BITS), wp.constant(2 ** (PLACE_BITS - 1))
BEGIN, BEYOND, CENTER = wp.constant(START), wp.constant(WIDEST), wp.constant(MIDDLE)


@wp.func
def placed(x: wp.float64) -> wp.float64:
    """Round a coordinate to 2^-23: first, beside a large number, to 2^-32."""
    if wp.abs(x) < wp.float64(BEYOND):
        steps = wp.floor((x + wp.float64(BEGIN)) * wp.float64(STEPS))
        return steps / wp.float64(STEPS) - wp.float64(CENTER)
    return x


@lru_cache
def byte_pixel() -> Any:
    """Return the function that finds a pixel of the result."""
    weights_t, indices_t, indices, weights, _ = taps(1)
    store = stored(wp.uint8)

    @wp.func
    def mix(
        src: wp.array4d[wp.uint8],
        p: int,
        c: int,
        rows: indices_t,
        columns: indices_t,
        down: weights_t,
        along: weights_t,
    ) -> wp.uint8:
        a = int(along[1] * wp.float32(STEPS))
        b = int(down[1] * wp.float32(STEPS))
        both = wp.int32((wp.int64(a) * wp.int64(b)) >> wp.int64(BITS))
        total = int(HALF) + (int(ONE) - a - b + both) * int(src[p, rows[0], columns[0], c])
        total += (a - both) * int(src[p, rows[0], columns[1], c])
        total += (b - both) * int(src[p, rows[1], columns[0], c])
        total += both * int(src[p, rows[1], columns[1], c])
        return wp.uint8(total >> int(BITS))

    @wp.func
    def pixel(
        src: wp.array4d[wp.uint8],
        inverse: wp.array[wp.float64],
        border: int,
        cval: float,
        margin: int,
        i: int,
        j: int,
        # outputs
        dst: wp.array4d[wp.uint8],
    ):
        u = wp.float64(j)
        v = wp.float64(i)
        inverse_w = wp.float64(1.0) / (inverse[6] * u + (inverse[7] * v + inverse[8]))
        px = placed((inverse[0] * u + (inverse[1] * v + inverse[2])) * inverse_w)
        py = placed((inverse[3] * u + (inverse[4] * v + inverse[5])) * inverse_w)
        y = mapped(py, src.shape[1], border)[0]
        x = mapped(px, src.shape[2], border)[0]
        outside = y == wp.float64(AWAY) or x == wp.float64(AWAY)
        rows = indices_t()
        columns = indices_t()
        down = weights_t()
        along = weights_t()
        if not outside:
            rows = indices(y, src.shape[1], border)
            columns = indices(x, src.shape[2], border)
            down = weights(y)
            along = weights(x)
        for p in range(dst.shape[0]):
            for c in range(dst.shape[3]):
                if outside:
                    dst[p, i, j, c] = store(cval)
                else:
                    dst[p, i, j, c] = mix(src, p, c, rows, columns, down, along)

    return pixel
