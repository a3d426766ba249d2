"""The line of the samples of a window over its guides, in Taichi; residual.py has its use."""

import taichi as ti

from cvkern.kernels.codes.raw import FLOOR, TINY
from cvkern.kernels.taichi._rounding import product, quotient

vec8 = ti.types.vector(8, ti.f32)


@ti.func
def fit(m: vec8, prior: ti.f32, zero: ti.i32) -> ti.types.vector(3, ti.f32):
    """Return the weight w of a line, and w times its slope and its intercept.

    `m` has the means of samples p and guides q, then the means of uv, vv and uu, where u and v are
    what p and q are off the means of windows around them, then those of pp, pq and qq. With the
    variance l that is left, ``l = uu - uv^2 / vv``, the slope has a prior of 1 that weighs `prior`
    times l: ``a = (uv + prior l) / (vv + prior l)``. Lines weigh as little as samples are off.
    """
    mp, mq, uv, vv, uu = m[0], m[1], m[2], m[3], m[4]
    pp, qq = product(mp, mp, zero), product(mq, mq, zero)
    least = product(pp + qq, ti.cast(FLOOR, ti.f32), zero) + TINY
    left = uu - quotient(product(uv, uv, zero), vv + least, zero)
    extra = product(prior, left if left > 0.0 else 0.0, zero) + least
    a = quotient(uv + extra, vv + extra, zero)
    b = mp - product(a, mq, zero)
    rp, rc, rq = m[5] - pp, m[6] - product(mp, mq, zero), m[7] - qq
    off = (rp - product(2.0 * a, rc, zero)) + product(product(a, a, zero), rq, zero)
    w = quotient(1.0, (off if off > 0.0 else 0.0) + least, zero)
    return ti.Vector([w, product(w, a, zero), product(w, b, zero)])
