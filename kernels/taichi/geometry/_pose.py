"""Poses of a calibrated camera, from three points in space, in Taichi.

With the directions of three points seen, the ratio of two of their distances solves a quartic, and
the distances give the pose: x = R X + t [Grunert 1841; R. Haralick, C. Lee, K. Ottenberg and
M. Noelle, IJCV 13(3), 1994]. The residual is the distance of a projected point from where it is
seen, in pixels. The order of arithmetic is that of Warp's _pose.h, so both sets give the same bits.
"""

import taichi as ti

from cvkern.kernels.taichi._rounding import product, quotient, wide_product

from . import _epipolar as epipolar

f32x12 = ti.types.vector(12, ti.f32)
f64x3 = ti.types.vector(3, ti.f64)
f64x9 = ti.types.vector(9, ti.f64)
f64x12 = ti.types.vector(12, ti.f64)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


@ti.func
def project(h: f64x9, k: f64x9, zero: ti.i32) -> f64x12:
    """Return the projection K (R | t), (3, 4), of a model."""
    m, p = f64x12(0.0), f64x12(0.0)
    for i in ti.static(range(2)):
        for j in ti.static(range(3)):
            m[4 * i + j] = h[3 * i + j]
    for j in ti.static(range(3)):
        a, b = ti.static((j + 1) % 3, (j + 2) % 3)
        m[8 + j] = wide_product(h[a], h[3 + b], zero) - wide_product(h[b], h[3 + a], zero)
        m[4 * j + 3] = h[6 + j]
    for i in ti.static(range(3)):
        for j in ti.static(range(4)):
            one = wide_product(k[3 * i], m[j], zero) + wide_product(k[3 * i + 1], m[4 + j], zero)
            p[4 * i + j] = one + wide_product(k[3 * i + 2], m[8 + j], zero)
    return p


@ti.func
def residual(
    p: f32x12, x: ti.f32, y: ti.f32, z: ti.f32, u: ti.f32, v: ti.f32, zero: ti.i32
) -> ti.f32:
    """Return the squared distance of a projected point from where it is seen."""
    q = ti.Vector([0.0] * 3, ti.f32)
    for i in ti.static(range(3)):
        one = product(p[4 * i], x, zero) + product(p[4 * i + 1], y, zero)
        q[i] = (one + product(p[4 * i + 2], z, zero)) + p[4 * i + 3]
    w = quotient(1.0, q[2], zero)
    dx, dy = product(q[0], w, zero) - u, product(q[1], w, zero) - v
    square = ti.cast(1e30, ti.f32)
    if q[2] > 0.0:
        square = product(dx, dx, zero) + product(dy, dy, zero)
    return square


@ti.func
def _dot(f: f64x9, a: ti.template(), b: ti.template(), zero: ti.i32) -> ti.f64:
    """Return the product of two rows."""
    one = wide_product(f[3 * a], f[3 * b], zero) + wide_product(f[3 * a + 1], f[3 * b + 1], zero)
    return one + wide_product(f[3 * a + 2], f[3 * b + 2], zero)


@ti.func
def _straighten(given: f64x9, zero: ti.i32):
    """Return whether two rows can be made of length 1 and square to one another, and these."""
    h = given
    one = _dot(h, 0, 0, zero)
    found = one > ti.f64(1e-300) and one < ti.f64(1e300)
    if found:
        first = 1.0 / ti.sqrt(one)
        for j in ti.static(range(3)):
            h[j] = wide_product(h[j], first, zero)
        along = _dot(h, 0, 1, zero)
        for j in ti.static(range(3)):
            h[3 + j] = h[3 + j] - wide_product(along, h[j], zero)
        two = _dot(h, 1, 1, zero)
        found = two > ti.f64(1e-300)
        if found:
            second = 1.0 / ti.sqrt(two)
            for j in ti.static(range(3)):
                h[3 + j] = wide_product(h[3 + j], second, zero)
    return found, h


@ti.func
def _frame(points: f64x9, zero: ti.i32):
    """Return whether points are a triangle, and its frame: along a side, in its plane, square."""
    f = f64x9(0.0)
    for j in ti.static(range(3)):
        f[j], f[3 + j] = points[3 + j] - points[j], points[6 + j] - points[j]
    found, g = _straighten(f, zero)
    for j in ti.static(range(3)):
        p, q = ti.static((j + 1) % 3, (j + 2) % 3)
        g[6 + j] = wide_product(g[p], g[3 + q], zero) - wide_product(g[q], g[3 + p], zero)
    return found, g


@ti.func
def _rays(u: ti.template(), v: ti.template(), inverse: f64x9, zero: ti.i32) -> f64x9:
    """Return the directions, by rows, of three points of the image."""
    ray = f64x9(0.0)
    for n in ti.static(range(3)):
        square = ti.f64(0.0)
        for i in ti.static(range(3)):
            one = wide_product(inverse[3 * i], u[n], zero)
            one = one + wide_product(inverse[3 * i + 1], v[n], zero)
            ray[3 * n + i] = one + inverse[3 * i + 2]
            square = square + wide_product(ray[3 * n + i], ray[3 * n + i], zero)
        length = 1.0 / ti.sqrt(square)
        for i in ti.static(range(3)):
            ray[3 * n + i] = wide_product(ray[3 * n + i], length, zero)
    return ray


@ti.func
def three(
    x: ti.template(),
    y: ti.template(),
    z: ti.template(),
    u: ti.template(),
    v: ti.template(),
    inverse: f64x9,
    flat: ti.f64,
    work: f64_3,
    notes: i32_3,
    t: ti.i32,
    zero: ti.i32,
) -> ti.i32:
    """Solve for the models of three points, at most four; return their number."""
    ray, point = _rays(u, v, inverse, zero), f64x9(0.0)
    for n in ti.static(range(3)):
        point[3 * n], point[3 * n + 1], point[3 * n + 2] = x[n], y[n], z[n]
    side, angle, count, apart = f64x3(0.0), f64x3(0.0), 0, True
    for n in ti.static(range(3)):
        a, b = ti.static(3 * ((n + 1) % 3), 3 * ((n + 2) % 3))
        for i in ti.static(range(3)):
            gap = point[a + i] - point[b + i]
            side[n] = side[n] + wide_product(gap, gap, zero)
            angle[n] = angle[n] + wide_product(ray[a + i], ray[b + i], zero)
        apart = apart and side[n] > flat
    found, world = _frame(point, zero)
    if apart and found:
        _quartic(side, angle, work, t, zero)
        for turn in range(2):
            number = epipolar.roots(work, notes, t, epipolar.POLYNOMIAL + turn, 4, zero)
            for n in range(number):
                far = work[t, epipolar.ROOTS, n]
                if count < 4 and far > ti.f64(1e-6):
                    if turn == 1:
                        far = 1.0 / far
                    real, seen = _seen(side, angle, ray, far, zero)
                    if real:
                        good, h = _aligned(seen, world, point, zero)
                        for k in ti.static(range(9)):
                            work[t, epipolar.MODELS + count, k] = h[k]
                        if good:
                            count += 1
    return count


@ti.func
def _quartic(side: f64x3, angle: f64x3, work: f64_3, t: ti.i32, zero: ti.i32):
    """Set up Grunert's quartic for s3 / s1 and the same for s1 / s3."""
    a, c = side[0] / side[1], side[2] / side[1]
    d, whole = a - c, a + c
    ca, cb, cg = angle[0], angle[1], angle[2]
    aa, bb = wide_product(ca, ca, zero), wide_product(cb, cb, zero)
    gg, ag = wide_product(cg, cg, zero), wide_product(ca, cg, zero)
    p = ti.Vector([0.0] * 5, ti.f64)
    p[4] = wide_product(d - 1.0, d - 1.0, zero) - wide_product(4.0 * c, aa, zero)
    mixed = wide_product(1.0 - whole, ag, zero)
    one = wide_product(wide_product(d, 1.0 - d, zero), cb, zero) - mixed
    p[3] = 4.0 * (one + wide_product(wide_product(2.0 * c, aa, zero), cb, zero))
    one = (wide_product(d, d, zero) - 1.0) + wide_product(2.0 * wide_product(d, d, zero), bb, zero)
    one = one + wide_product(2.0 * (1.0 - c), aa, zero)
    two = wide_product(2.0 * (1.0 - a), gg, zero)
    two = two - wide_product(4.0 * whole, wide_product(ag, cb, zero), zero)
    p[2] = 2.0 * (one + two)
    one = wide_product(wide_product(2.0 * a, gg, zero), cb, zero)
    one = one - wide_product(wide_product(d, 1.0 + d, zero), cb, zero)
    p[1] = 4.0 * (one - mixed)
    p[0] = wide_product(1.0 + d, 1.0 + d, zero) - wide_product(4.0 * a, gg, zero)
    for k in ti.static(range(5)):
        work[t, epipolar.POLYNOMIAL, k] = p[k]
        work[t, epipolar.POLYNOMIAL + 1, k] = p[4 - k]


@ti.func
def _seen(side: f64x3, angle: f64x3, ray: f64x9, far: ti.f64, zero: ti.i32):
    """Return whether s3 / s1 is that of three points before the camera, and these."""
    d = side[0] / side[1] - side[2] / side[1]
    square = wide_product(far, far, zero)
    under = 2.0 * (angle[2] - wide_product(far, angle[0], zero))
    real, near, one = ti.abs(under) > ti.f64(1e-9), ti.f64(0.0), ti.f64(0.0)
    seen = f64x9(0.0)
    if real:
        above = wide_product(d - 1.0, square, zero)
        above = above - wide_product(wide_product(2.0 * d, angle[1], zero), far, zero)
        near = (above + (1.0 + d)) / under
        below = (1.0 + square) - wide_product(2.0 * far, angle[1], zero)
        one = side[1] / below
        real = near > 0.0 and one > 0.0
    if real:
        s = ti.sqrt(one)
        for i in ti.static(range(3)):
            seen[i] = wide_product(s, ray[i], zero)
            seen[3 + i] = wide_product(wide_product(near, s, zero), ray[3 + i], zero)
            seen[6 + i] = wide_product(wide_product(far, s, zero), ray[6 + i], zero)
    return real, seen


@ti.func
def _aligned(seen: f64x9, world: f64x9, point: f64x9, zero: ti.i32):
    """Return whether points seen are a triangle, and the model that moves `point` there."""
    good, frame = _frame(seen, zero)
    r, h = f64x9(0.0), f64x9(0.0)
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            one = wide_product(frame[i], world[j], zero)
            one = one + wide_product(frame[3 + i], world[3 + j], zero)
            r[3 * i + j] = one + wide_product(frame[6 + i], world[6 + j], zero)
    for i in ti.static(range(6)):
        h[i] = r[i]
    for i in ti.static(range(3)):
        one = wide_product(r[3 * i], point[0], zero) + wide_product(r[3 * i + 1], point[1], zero)
        h[6 + i] = seen[i] - (one + wide_product(r[3 * i + 2], point[2], zero))
    return good, h


@ti.func
def derive(h: f64x9, k: f64x9, x: ti.template(), u: ti.f64, v: ti.f64, limit: ti.f64, zero: ti.i32):
    """Return whether a match counts, slopes against a turn and a shift, residuals, its weight."""
    p = project(h, k, zero)
    q, turned = f64x3(0.0), f64x3(0.0)
    for i in ti.static(range(3)):
        one = wide_product(p[4 * i], x[0], zero) + wide_product(p[4 * i + 1], x[1], zero)
        q[i] = (one + wide_product(p[4 * i + 2], x[2], zero)) + p[4 * i + 3]
    inverse = 1.0 / q[2]
    at = ti.Vector([wide_product(q[0], inverse, zero), wide_product(q[1], inverse, zero)])
    e = ti.Vector([at[0] - u, at[1] - v])
    third = f64x3(0.0)
    for j in ti.static(range(3)):
        a, b = ti.static((j + 1) % 3, (j + 2) % 3)
        third[j] = wide_product(h[a], h[3 + b], zero) - wide_product(h[b], h[3 + a], zero)
    for i in ti.static(range(3)):
        row = third
        if ti.static(i < 2):
            for j in ti.static(range(3)):
                row[j] = h[3 * i + j]
        one = wide_product(row[0], x[0], zero) + wide_product(row[1], x[1], zero)
        turned[i] = one + wide_product(row[2], x[2], zero)
    t = f64x12(0.0)
    for i in ti.static(range(2)):
        for j in ti.static(range(3)):
            gap = k[3 * i + j] - wide_product(at[i], k[6 + j], zero)
            t[6 * i + 3 + j] = wide_product(gap, inverse, zero)
        for j in ti.static(range(3)):
            a, b = ti.static((j + 1) % 3, (j + 2) % 3)
            one = wide_product(turned[a], t[6 * i + 3 + b], zero)
            t[6 * i + j] = one - wide_product(turned[b], t[6 * i + 3 + a], zero)
    square = wide_product(e[0], e[0], zero) + wide_product(e[1], e[1], zero)
    counts = q[2] > 0.0 and square < limit
    return counts, t, e, epipolar.weight(square, limit, zero)


@ti.func
def equations(sums: f64_3, item: ti.i32, a: f64_3) -> ti.f64:
    """Set up a step; return the trace of its equations."""
    at = 0
    trace = ti.f64(0.0)
    for i in range(6):
        for j in range(i, 6):
            a[item, i, j] = sums[item, at, 0]
            a[item, j, i] = sums[item, at, 0]
            at += 1
        a[item, i, 9] = -sums[item, 21 + i, 0]
    for i in range(6):
        trace = trace + a[item, i, i]
    return trace


@ti.func
def move(a: f64_3, item: ti.i32, trial: f64_2, zero: ti.i32) -> ti.i32:
    """Turn and shift a model by the solution; tell whether that can be."""
    h, turned = f64x9(0.0), f64x9(0.0)
    for k in ti.static(range(9)):
        h[k] = trial[item, k]
    r = ti.Vector([0.5 * a[item, 9, 0], 0.5 * a[item, 9, 1], 0.5 * a[item, 9, 2]])
    square = wide_product(r[0], r[0], zero) + wide_product(r[1], r[1], zero)
    square = square + wide_product(r[2], r[2], zero)
    for j in ti.static(range(3)):
        k, n = ti.static((j + 1) % 3, (j + 2) % 3)
        one = wide_product(h[k], h[3 + n], zero)
        c = ti.Vector([h[j], h[3 + j], one - wide_product(h[n], h[3 + k], zero)])
        along = wide_product(r[0], c[0], zero) + wide_product(r[1], c[1], zero)
        along = along + wide_product(r[2], c[2], zero)
        for i in ti.static(range(2)):
            m, o = ti.static((i + 1) % 3, (i + 2) % 3)
            across = wide_product(r[m], c[o], zero) - wide_product(r[o], c[m], zero)
            one = wide_product(1.0 - square, c[i], zero)
            one = one + wide_product(2.0 * along, r[i], zero)
            turned[3 * i + j] = (one + 2.0 * across) / (1.0 + square)
    for i in ti.static(range(3)):
        turned[6 + i] = h[6 + i] + a[item, 9, 3 + i]
    found, straight = _straighten(turned, zero)
    for k in ti.static(range(9)):
        trial[item, k] = straight[k]
    return ti.cast(found, ti.i32)
