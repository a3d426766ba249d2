"""Fundamental matrices in Taichi: from seven matches, from a plane, and their refinement.

Each match gives one linear equation ``(u, v, 1) F (x, y, 1)' = 0``. Seven of them leave two null
vectors A and B, and ``det(a A + (1 - a) B) = 0`` is a cubic, whose real roots Sturm's chain and
Newton's steps find [R. Hartley and A. Zisserman, "Multiple View Geometry", 2004, section 11.1.2].
With the homography H of a plane and two matches off it, ``F = [e]x H`` [O. Chum, T. Werner and
J. Matas, CVPR 2005]. The residual is Sampson's distance,
``(b' F a)^2 / (|(F a)_12|^2 + |(F' b)_12|^2)``.

A thread has a page of memory: `work` (rows, columns) float64 and `notes` (2, 12) int32, at `t`.
The order of arithmetic is that of Warp's _epipolar.h, so both sets give the same bits.
"""

import taichi as ti

from cvkern.kernels.taichi._rounding import product, quotient, wide_product

f32x12 = ti.types.vector(12, ti.f32)
f64x2 = ti.types.vector(2, ti.f64)
f64x9 = ti.types.vector(9, ti.f64)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)

PAGE, NOTES = (36, 12), (2, 12)
# Rows of `work`: equations, null vectors, a polynomial and the same in 1 / t, its roots, Sturm's
# chain, models.
NULL, POLYNOMIAL, ROOTS, CHAIN, MODELS = 7, 11, 13, 14, 26
NAMES, DEGREES = 0, 1  # rows of `notes`


@ti.func
def null_space(work: f64_3, notes: i32_3, t: ti.i32, r: ti.i32, zero: ti.i32) -> ti.i32:
    """Find null vectors of r equations; tell whether there are just 9 - r."""
    fixed = 1
    for j in range(9):
        notes[t, NAMES, j] = j
    for k in range(r):
        most = ti.cast(0.0, ti.f64)
        column = k
        for j in range(k, 9):
            if ti.abs(work[t, k, j]) > most:
                most = ti.abs(work[t, k, j])
                column = j
        if not most > ti.f64(1e-9):
            fixed = 0
        if fixed:
            for i in range(r):
                work[t, i, k], work[t, i, column] = work[t, i, column], work[t, i, k]
            name = notes[t, NAMES, k]
            notes[t, NAMES, k] = notes[t, NAMES, column]
            notes[t, NAMES, column] = name
            inverse = 1.0 / work[t, k, k]
            for j in range(k + 1, 9):
                work[t, k, j] = wide_product(work[t, k, j], inverse, zero)
            for i in range(r):
                if i != k:
                    factor = work[t, i, k]
                    for j in range(k + 1, 9):
                        work[t, i, j] = work[t, i, j] - wide_product(factor, work[t, k, j], zero)
    if fixed:
        for n in range(r, 9):
            for j in range(r, 9):
                value = ti.cast(0.0, ti.f64)
                if j == n:
                    value = 1.0
                work[t, NULL + n - r, notes[t, NAMES, j]] = value
            for i in range(r):
                work[t, NULL + n - r, notes[t, NAMES, i]] = -work[t, i, n]
    return fixed


@ti.func
def cofactors(f: f64x9, zero: ti.i32) -> f64x9:
    """Return the cofactors of a matrix."""
    c = f64x9(0.0)
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            a, b = ti.static((i + 1) % 3, (i + 2) % 3)
            p, q = ti.static((j + 1) % 3, (j + 2) % 3)
            one = wide_product(f[3 * a + p], f[3 * b + q], zero)
            c[3 * i + j] = one - wide_product(f[3 * a + q], f[3 * b + p], zero)
    return c


@ti.func
def _scale(work: f64_3, t: ti.i32, row: ti.i32, begin: ti.i32, zero: ti.i32) -> ti.i32:
    """Scale a polynomial to a largest coefficient of 1; return its degree, or -1."""
    degree = begin
    most = ti.cast(0.0, ti.f64)
    for k in range(begin + 1):
        most = ti.max(most, ti.abs(work[t, row, k]))
    if most > ti.f64(1e-300):
        inverse = 1.0 / most
        for k in range(begin + 1):
            work[t, row, k] = wide_product(work[t, row, k], inverse, zero)
        while degree > 0 and ti.abs(work[t, row, degree]) < ti.f64(1e-12):
            degree -= 1
    else:
        degree = -1
    return degree


@ti.func
def _value(work: f64_3, t: ti.i32, row: ti.i32, degree: ti.i32, x: ti.f64, zero: ti.i32) -> f64x2:
    """Return a polynomial at x, and its derivative."""
    value = work[t, row, degree]
    slope = ti.cast(0.0, ti.f64)
    for back in range(degree):
        slope = wide_product(slope, x, zero) + value
        value = wide_product(value, x, zero) + work[t, row, degree - 1 - back]
    return f64x2(value, slope)


@ti.func
def _changes(
    work: f64_3, notes: i32_3, t: ti.i32, length: ti.i32, x: ti.f64, zero: ti.i32
) -> ti.i32:
    """Count how often the signs of Sturm's chain change at x."""
    count = 0
    last = ti.cast(0.0, ti.f64)
    for i in range(length):
        value = _value(work, t, CHAIN + i, notes[t, DEGREES, i], x, zero)[0]
        if wide_product(last, value, zero) < 0.0:  # 0 is no sign
            count += 1
        if value != 0.0:
            last = value
    return count


@ti.func
def _divide(work: f64_3, notes: i32_3, t: ti.i32, length: ti.i32, zero: ti.i32) -> ti.i32:
    """Append the negative remainder of the last two of the chain; return its new length."""
    above, by, rest = CHAIN + length - 2, CHAIN + length - 1, CHAIN + length
    begin, to = notes[t, DEGREES, length - 2], notes[t, DEGREES, length - 1]
    inverse = 1.0 / work[t, by, to]
    for k in range(begin + 1):
        work[t, rest, k] = -work[t, above, k]
    for back in range(begin - to + 1):
        d = begin - back
        factor = wide_product(work[t, rest, d], inverse, zero)
        for k in range(to):
            work[t, rest, d - to + k] = work[t, rest, d - to + k] - wide_product(
                factor, work[t, by, k], zero
            )
    notes[t, DEGREES, length] = _scale(work, t, rest, to - 1, zero)
    return length + 1


@ti.func
def _alone(work: f64_3, t: ti.i32, first: ti.i32, begin: ti.f64, end: ti.f64, zero: ti.i32):
    """Return the only root in (begin, end], by Newton's steps.

    Bisection takes their place where they leave the interval or do not halve the step before.
    """
    low, high = begin, end
    top = _value(work, t, CHAIN, first, high, zero)[0]
    x, last = (low + high) * 0.5, high - low
    step = 0
    while step < 48 and last > ti.f64(1e-11):
        at = _value(work, t, CHAIN, first, x, zero)
        if (top > 0.0 and at[0] >= 0.0) or (top < 0.0 and at[0] <= 0.0):
            high = x
        else:
            low = x
        there = x - at[0] / at[1]
        moved = ti.abs(there - x)
        if not (there > low and there < high and moved + moved <= last):
            there = (low + high) * 0.5
        last = ti.abs(there - x)
        x = there
        step += 1
    return x


@ti.func
def roots(
    work: f64_3, notes: i32_3, t: ti.i32, row: ti.i32, degree: ti.i32, zero: ti.i32
) -> ti.i32:
    """Find real roots in (-1, 1] of a polynomial.

    Sturm's chain and bisection tell where a root is alone, and Newton's steps lead to it.
    """
    for k in range(degree + 1):
        work[t, CHAIN, k] = work[t, row, k]
    first = _scale(work, t, CHAIN, degree, zero)
    notes[t, DEGREES, 0] = first
    count = 0
    if first >= 1:
        for k in range(first):
            work[t, CHAIN + 1, k] = ti.cast(k + 1, ti.f64) * work[t, CHAIN, k + 1]
        notes[t, DEGREES, 1] = _scale(work, t, CHAIN + 1, first - 1, zero)
        length = 2
        while notes[t, DEGREES, length - 1] > 0:
            length = _divide(work, notes, t, length, zero)
        if notes[t, DEGREES, length - 1] < 0:
            length -= 1
        before = _changes(work, notes, t, length, ti.f64(-1.0), zero)
        count = before - _changes(work, notes, t, length, ti.f64(1.0), zero)
        begin = ti.f64(-1.0)
        for n in range(count):
            low, high = begin, ti.f64(1.0)
            below, upto = n, count  # the number of roots in (-1, low] and in (-1, high]
            step = 0
            while step < 36 and upto - below > 1:
                middle = (low + high) * 0.5
                now = before - _changes(work, notes, t, length, middle, zero)
                if now > n:
                    high = middle
                    upto = now
                else:
                    low = middle
                    below = now
                step += 1
            begin = high
            work[t, ROOTS, n] = _alone(work, t, first, low, high, zero)
    return ti.max(count, 0)


@ti.func
def row_of(work: f64_3, t: ti.i32, row: ti.i32) -> f64x9:
    """Return nine numbers of a page."""
    values = f64x9(0.0)
    for k in ti.static(range(9)):
        values[k] = work[t, row, k]
    return values


@ti.func
def seven(work: f64_3, notes: i32_3, t: ti.i32, zero: ti.i32) -> ti.i32:
    """Solve for the matrices of seven matches, whose equations are in `work`, at most three."""
    count = 0
    if null_space(work, notes, t, 7, zero):
        a, b = row_of(work, t, NULL), row_of(work, t, NULL + 1)
        c, d = cofactors(a, zero), cofactors(b, zero)
        p = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
        for k in ti.static(range(3)):
            p[0] += wide_product(a[k], c[k], zero)
            p[3] += wide_product(b[k], d[k], zero)
        for k in ti.static(range(9)):
            p[1] += wide_product(b[k], c[k], zero)
            p[2] += wide_product(a[k], d[k], zero)
        for k in ti.static(range(4)):
            work[t, POLYNOMIAL, k] = p[k]
            work[t, POLYNOMIAL + 1, k] = p[3 - k]
        for side in range(2):
            number = roots(work, notes, t, POLYNOMIAL + side, 3, zero)
            for n in range(number):
                if count < 3:
                    root = work[t, ROOTS, n]
                    for k in range(9):
                        one, other = work[t, NULL + side, k], work[t, NULL + 1 - side, k]
                        work[t, MODELS + count, k] = one + wide_product(root, other, zero)
                    count += 1
    return count


@ti.func
def parallax(
    x: ti.template(), y: ti.template(), u: ti.template(), v: ti.template(), h: f64x9, zero: ti.i32
):
    """Return whether two matches off a plane fix the epipole, and then [e] H."""
    line = ti.Matrix([[0.0] * 3] * 2, ti.f64)
    for i in ti.static(range(2)):
        q = ti.Vector([0.0] * 3, ti.f64)
        for k in ti.static(range(3)):
            one = wide_product(h[3 * k], x[i], zero) + wide_product(h[3 * k + 1], y[i], zero)
            q[k] = one + h[3 * k + 2]
        line[i, 0] = wide_product(v[i], q[2], zero) - q[1]
        line[i, 1] = q[0] - wide_product(u[i], q[2], zero)
        line[i, 2] = wide_product(u[i], q[1], zero) - wide_product(v[i], q[0], zero)
    e = ti.Vector([0.0] * 3, ti.f64)
    most = ti.cast(0.0, ti.f64)
    for k in ti.static(range(3)):
        p, q = ti.static((k + 1) % 3, (k + 2) % 3)
        one = wide_product(line[0, p], line[1, q], zero)
        e[k] = one - wide_product(line[0, q], line[1, p], zero)
        most = ti.max(most, ti.abs(e[k]))
    found = most > ti.f64(1e-12)
    f = f64x9(0.0)
    if found:
        for k in ti.static(range(3)):
            e[k] = e[k] / most
        for j in ti.static(range(3)):
            for k in ti.static(range(3)):
                p, q = ti.static((k + 1) % 3, (k + 2) % 3)
                one = wide_product(e[p], h[3 * q + j], zero)
                f[3 * k + j] = one - wide_product(e[q], h[3 * p + j], zero)
    return found, f


@ti.func
def sampson(h: f32x12, x: ti.f32, y: ti.f32, u: ti.f32, v: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the square of Sampson's distance."""
    a = (product(h[0], x, zero) + product(h[1], y, zero)) + h[2]
    b = (product(h[3], x, zero) + product(h[4], y, zero)) + h[5]
    c = (product(h[6], x, zero) + product(h[7], y, zero)) + h[8]
    d = (product(h[0], u, zero) + product(h[3], v, zero)) + h[6]
    e = (product(h[1], u, zero) + product(h[4], v, zero)) + h[7]
    n = (product(a, u, zero) + product(b, v, zero)) + c
    under = product(a, a, zero) + product(b, b, zero)
    under = under + (product(d, d, zero) + product(e, e, zero))
    return quotient(product(n, n, zero), under, zero)


@ti.func
def unit(work: f64_3, t: ti.i32, row: ti.i32) -> ti.i32:
    """Scale a matrix to a largest element of 1; tell whether it has one."""
    largest = ti.cast(0.0, ti.f64)
    for i in range(9):
        if ti.abs(work[t, row, i]) > largest:
            largest = ti.abs(work[t, row, i])
    found = 0
    if largest > 0.0 and largest < ti.f64(1e300):
        found = 1
        inverse = 1.0 / largest
        for i in range(9):
            work[t, row, i] = work[t, row, i] * inverse
    return found


@ti.func
def weight(square: ti.f64, limit: ti.f64, zero: ti.i32) -> ti.f64:
    """Return Cauchy's weight, of a third of the limit's root, fading to 0 there."""
    x = square / limit
    rest = 1.0 - x
    return wide_product(rest, rest, zero) / (1.0 + wide_product(10.0, x, zero))


@ti.func
def derive(h: f64x9, x: ti.f64, y: ti.f64, u: ti.f64, v: ti.f64, limit: ti.f64, zero: ti.i32):
    """Return whether a match counts, derivatives of its equation, its value and square weight."""
    a = (wide_product(h[0], x, zero) + wide_product(h[1], y, zero)) + h[2]
    b = (wide_product(h[3], x, zero) + wide_product(h[4], y, zero)) + h[5]
    c = (wide_product(h[6], x, zero) + wide_product(h[7], y, zero)) + h[8]
    d = (wide_product(h[0], u, zero) + wide_product(h[3], v, zero)) + h[6]
    e = (wide_product(h[1], u, zero) + wide_product(h[4], v, zero)) + h[7]
    n = (wide_product(a, u, zero) + wide_product(b, v, zero)) + c
    under = wide_product(a, a, zero) + wide_product(b, b, zero)
    w = 1.0 / (under + (wide_product(d, d, zero) + wide_product(e, e, zero)))
    square = wide_product(wide_product(n, n, zero), w, zero)
    s = wide_product(n, w, zero)
    p, q = u - wide_product(s, a, zero), v - wide_product(s, b, zero)
    f, g = wide_product(s, d, zero), wide_product(s, e, zero)
    t = f64x9(1.0)
    t[0] = wide_product(p, x, zero) - wide_product(f, u, zero)
    t[1] = wide_product(p, y, zero) - wide_product(g, u, zero)
    t[2] = p
    t[3] = wide_product(q, x, zero) - wide_product(f, v, zero)
    t[4] = wide_product(q, y, zero) - wide_product(g, v, zero)
    t[5] = q
    t[6], t[7] = x - f, y - g
    return square < limit, t, n, wide_product(w, weight(square, limit, zero), zero)


@ti.func
def equations(sums: f64_3, trial: f64_2, item: ti.i32, matrix: f64_3, zero: ti.i32):
    """Set up a step from sums, square to F and to a determinant of 0; return whether, the trace."""
    k = 0
    for i in range(9):
        for j in range(i, 9):
            matrix[item, i, j] = sums[item, k, 0]
            matrix[item, j, i] = sums[item, k, 0]
            k += 1
        matrix[item, i, 9] = -sums[item, 45 + i, 0]
    trace, determinant, square = ti.f64(0.0), ti.f64(0.0), ti.f64(0.0)
    for i in range(9):
        trace = trace + matrix[item, i, i]
    h = f64x9(0.0)
    for i in ti.static(range(9)):
        h[i] = trial[item, i]
    c = cofactors(h, zero)
    for i in ti.static(range(3)):
        determinant = determinant + wide_product(h[i], c[i], zero)
    for i in ti.static(range(9)):
        square = square + wide_product(c[i], c[i], zero)
    found = square > ti.f64(1e-30)
    if found:
        weight = 1e6 * trace / square
        for i in range(9):
            for j in range(9):
                one = wide_product(wide_product(trace, h[i], zero), h[j], zero)
                two = wide_product(wide_product(weight, c[i], zero), c[j], zero)
                matrix[item, i, j] = (matrix[item, i, j] + one) + two
            pull = wide_product(wide_product(weight, determinant, zero), c[i], zero)
            matrix[item, i, 9] = matrix[item, i, 9] - pull
    return found, trace
