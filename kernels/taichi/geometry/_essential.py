"""Essential matrices of calibrated cameras, from five matches, in Taichi.

Five matches leave ``E = x X + y Y + z Z + W``. The ten cubic equations ``det E = 0`` and
``2 E E' E - tr(E E') E = 0`` are reduced by elimination to a polynomial of degree ten in z. Sturm's
chain isolates its real roots, and Newton's steps find them; x and y follow [D. Nister, "An
efficient solution to the five-point relative pose problem", IEEE PAMI 26(6), 2004]. A step of
refinement turns E from either side. The order of arithmetic is that of Warp's _essential.h, so both
sets give the same bits.
"""

import taichi as ti

from cvkern.kernels.taichi._rounding import wide_product

from . import _epipolar as epipolar

f64x9 = ti.types.vector(9, ti.f64)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)

PAGE = (64, 20)
# Rows of a page behind those of all epipolar geometries: ten equations in 20 monomials, nine
# polynomials, both cameras, and what is at hand.
CONSTRAINTS, POLYNOMIALS, CAMERAS, E, HALF, HAND = 36, 46, 55, 57, 58, 59
# Rows of the scratch of a step: turns of E from either side, the same as turns of F, products,
# the cameras, E, half a product, and F.
MOVES, SLOPES, PRODUCTS, MATRICES, TRIAL, PART, MOVED, ROWS = 10, 16, 22, 28, 32, 33, 34, 35
# Columns of monomials with so many x and y, and no z; in Nister's order.
_BASES = (16, 13, 6, 1, 10, 8, 3, 0, 4, 2, 0, 0, 0, 0, 0, 0)


@ti.func
def camera(cameras: f64_2, pair: ti.i32, which: ti.template()) -> f64x9:
    """Return one of the matrices of a pair."""
    values = f64x9(0.0)
    for k in ti.static(range(9)):
        values[k] = cameras[pair, 9 * which + k]
    return values


@ti.func
def _three(
    w: f64_3, t: ti.i32, p: ti.i32, i: ti.i32, m: ti.i32, q: ti.i32, j: ti.i32, n: ti.i32,
    zero: ti.i32,
) -> ti.f64:  # fmt: skip
    """Return the product of three numbers of row p from i on, m apart, and three of row q."""
    one = wide_product(w[t, p, i], w[t, q, j], zero)
    one = one + wide_product(w[t, p, i + m], w[t, q, j + n], zero)
    return one + wide_product(w[t, p, i + 2 * m], w[t, q, j + 2 * n], zero)


@ti.func
def between(
    w: f64_3, t: ti.i32, a1: ti.i32, e: ti.i32, a0: ti.i32, half: ti.i32, to: ti.i32, zero: ti.i32
):
    """Write A1' E A0 into a row, from rows."""
    for k in range(9):
        w[t, half, k] = _three(w, t, e, k // 3 * 3, 1, a0, k % 3, 3, zero)
    for k in range(9):
        w[t, to, k] = _three(w, t, a1, k // 3, 3, half, k % 3, 3, zero)


@ti.func
def _column(i: ti.i32, j: ti.i32, k: ti.i32) -> ti.i32:
    """Return the column of the monomial of three of x, y, z and 1."""
    along = ti.cast(i == 0, ti.i32) + ti.cast(j == 0, ti.i32) + ti.cast(k == 0, ti.i32)
    down = ti.cast(i == 1, ti.i32) + ti.cast(j == 1, ti.i32) + ti.cast(k == 1, ti.i32)
    last = ti.cast(i == 3, ti.i32) + ti.cast(j == 3, ti.i32) + ti.cast(k == 3, ti.i32)
    base = 0
    for n in ti.static(range(16)):
        if 4 * along + down == n:
            base = _BASES[n]
    return base + last


@ti.func
def _crossed(work: f64_3, t: ti.i32, p: ti.i32, q: ti.i32, a: ti.i32, zero: ti.i32) -> ti.f64:
    """Return an element of the second row of one matrix times the third row of another."""
    b, d = (a + 1) % 3, (a + 2) % 3
    one = wide_product(work[t, p, 3 + b], work[t, q, 6 + d], zero)
    return one - wide_product(work[t, p, 3 + d], work[t, q, 6 + b], zero)


@ti.func
def _constraints(work: f64_3, t: ti.i32, zero: ti.i32):
    """Set up 2 E E' E - tr(E E') E = 0 and det E = 0 for E = x X + y Y + z Z + W."""
    s, c = HAND, HAND + 1
    for r in range(10):
        for k in range(20):
            work[t, CONSTRAINTS + r, k] = 0.0
    for both in range(16):
        i, j = both // 4, both % 4
        p, q = epipolar.NULL + i, epipolar.NULL + j
        if i <= j:
            for k in range(9):
                a, b = k // 3 * 3, k % 3 * 3
                total = _three(work, t, p, a, 1, q, b, 1, zero)
                if i < j:
                    total = total + _three(work, t, q, a, 1, p, b, 1, zero)
                work[t, s, k] = total
            for a in range(3):
                one = _crossed(work, t, p, q, a, zero)
                if i < j:
                    one = one + _crossed(work, t, q, p, a, zero)
                work[t, c, a] = one
            trace = (work[t, s, 0] + work[t, s, 4]) + work[t, s, 8]
            for k in range(4):
                e, at = epipolar.NULL + k, _column(i, j, k)
                for n in range(9):
                    total = _three(work, t, s, n // 3 * 3, 1, e, n % 3, 3, zero)
                    more = 2.0 * total - wide_product(trace, work[t, e, n], zero)
                    work[t, CONSTRAINTS + n, at] = work[t, CONSTRAINTS + n, at] + more
                more = _three(work, t, e, 0, 1, c, 0, 1, zero)
                work[t, CONSTRAINTS + 9, at] = work[t, CONSTRAINTS + 9, at] + more


@ti.func
def _reduce(work: f64_3, t: ti.i32, zero: ti.i32) -> ti.i32:
    """Eliminate the ten monomials of degree 2 and 3 in x and y; tell whether that can be."""
    fixed = 1
    for k in range(10):
        most = ti.cast(0.0, ti.f64)
        pivot = k
        for i in range(k, 10):
            if ti.abs(work[t, CONSTRAINTS + i, k]) > most:
                most = ti.abs(work[t, CONSTRAINTS + i, k])
                pivot = i
        if not most > ti.f64(1e-12):
            fixed = 0
        if fixed:
            one = CONSTRAINTS + k
            for j in range(k, 20):
                other = work[t, one, j]
                work[t, one, j] = work[t, CONSTRAINTS + pivot, j]
                work[t, CONSTRAINTS + pivot, j] = other
            inverse = 1.0 / work[t, one, k]
            for j in range(k + 1, 20):
                work[t, one, j] = wide_product(work[t, one, j], inverse, zero)
            for i in range(10):
                if i > k or (i >= 4 and i < k):
                    factor = work[t, CONSTRAINTS + i, k]
                    for j in range(k + 1, 20):
                        work[t, CONSTRAINTS + i, j] = work[t, CONSTRAINTS + i, j] - wide_product(
                            factor, work[t, one, j], zero
                        )
    return fixed


@ti.func
def _polynomials(work: f64_3, t: ti.i32, zero: ti.i32):
    """Set up polynomials in z of the equations in (x, y, 1), and of their determinant."""
    for r in range(3):
        e, f = CONSTRAINTS + 4 + 2 * r, CONSTRAINTS + 5 + 2 * r
        for c in range(3):
            to, first, top = POLYNOMIALS + 3 * r + c, 10 + 3 * c, 2
            if c == 2:
                top = 3
            work[t, to, 4] = 0.0
            work[t, to, 0] = work[t, e, first + top]
            for k in range(1, top + 1):
                work[t, to, k] = work[t, e, first + top - k] - work[t, f, first + top + 1 - k]
            work[t, to, top + 1] = -work[t, f, first]
    p = epipolar.POLYNOMIAL
    for k in range(11):
        work[t, p, k] = 0.0
    minor = HAND
    for r in range(3):
        one, other = POLYNOMIALS + 3 * ((r + 1) % 3), POLYNOMIALS + 3 * ((r + 2) % 3)
        for k in range(7):
            work[t, minor, k] = 0.0
        for turn in range(2):  # the product of the diagonal, less the other
            for i in range(4):
                for j in range(4):
                    more = wide_product(work[t, one + turn, i], work[t, other + 1 - turn, j], zero)
                    if turn == 1:
                        more = -more
                    work[t, minor, i + j] = work[t, minor, i + j] + more
        for i in range(7):
            for j in range(5):
                more = wide_product(work[t, minor, i], work[t, POLYNOMIALS + 3 * r + 2, j], zero)
                work[t, p, i + j] = work[t, p, i + j] + more
    for k in range(11):
        work[t, p + 1, k] = work[t, p, 10 - k]


@ti.func
def _minor(work: f64_3, t: ti.i32, p: ti.i32, q: ti.i32, i: ti.i32, j: ti.i32, zero: ti.i32):
    """Return a determinant of two rows of three, of those at hand."""
    one = wide_product(work[t, HAND, p + i], work[t, HAND, q + j], zero)
    return one - wide_product(work[t, HAND, p + j], work[t, HAND, q + i], zero)


@ti.func
def _unknowns(work: f64_3, t: ti.i32, z: ti.f64, zero: ti.i32):
    """Return whether the equations at z fix x and y, and these."""
    most, x, y = ti.f64(0.0), ti.f64(0.0), ti.f64(0.0)
    for i in range(9):
        value = work[t, POLYNOMIALS + i, 4]
        for back in range(4):
            value = wide_product(value, z, zero) + work[t, POLYNOMIALS + i, 3 - back]
        work[t, HAND, i] = value
    for r in range(3):
        p, q = 3 * ((r + 1) % 3), 3 * ((r + 2) % 3)
        w = _minor(work, t, p, q, 0, 1, zero)
        if ti.abs(w) > most:
            most = ti.abs(w)
            x = _minor(work, t, p, q, 1, 2, zero) / w
            y = _minor(work, t, p, q, 2, 0, zero) / w
    return most > 0.0, x, y


@ti.func
def five(
    x: ti.template(),
    y: ti.template(),
    u: ti.template(),
    v: ti.template(),
    cameras: f64_2,
    pair: ti.i32,
    work: f64_3,
    notes: i32_3,
    t: ti.i32,
    zero: ti.i32,
) -> ti.i32:
    """Solve for the models of five matches, at most ten; return their number."""
    for k in range(18):
        work[t, CAMERAS + k // 9, k % 9] = cameras[pair, k]
    for n in range(5):
        for i in range(3):
            one = wide_product(work[t, CAMERAS, 3 * i], x[n], zero)
            one = one + wide_product(work[t, CAMERAS, 3 * i + 1], y[n], zero)
            work[t, HAND, i] = one + work[t, CAMERAS, 3 * i + 2]
            one = wide_product(work[t, CAMERAS + 1, 3 * i], u[n], zero)
            one = one + wide_product(work[t, CAMERAS + 1, 3 * i + 1], v[n], zero)
            work[t, HAND, 3 + i] = one + work[t, CAMERAS + 1, 3 * i + 2]
        for k in range(9):
            work[t, n, k] = wide_product(work[t, HAND, 3 + k // 3], work[t, HAND, k % 3], zero)
    count = 0
    fixed = epipolar.null_space(work, notes, t, 5, zero)
    if fixed:
        _constraints(work, t, zero)
        fixed = _reduce(work, t, zero)
    if fixed:
        _polynomials(work, t, zero)
        for side in range(2):
            number = epipolar.roots(work, notes, t, epipolar.POLYNOMIAL + side, 10, zero)
            for n in range(number):
                z = work[t, epipolar.ROOTS, n]
                known = count < 10 and (side == 0 or ti.abs(z) > ti.f64(1e-9))
                if known and side == 1:
                    z = 1.0 / z
                if known:
                    known, p, q = _unknowns(work, t, z, zero)
                    if known:
                        for k in range(9):
                            one = wide_product(p, work[t, epipolar.NULL, k], zero)
                            one = one + wide_product(q, work[t, epipolar.NULL + 1, k], zero)
                            one = one + wide_product(z, work[t, epipolar.NULL + 2, k], zero)
                            work[t, E, k] = one + work[t, epipolar.NULL + 3, k]
                        to = epipolar.MODELS + count
                        between(work, t, CAMERAS + 1, E, CAMERAS, HALF, to, zero)
                        count += epipolar.unit(work, t, to)
    return count


@ti.func
def _polish(a: f64_3, item: ti.i32, zero: ti.i32):
    """Move the trial to the nearest matrix with two equal singular values and one of 0."""
    for _ in range(3):
        square, determinant = ti.f64(0.0), ti.f64(0.0)
        for i in range(9):
            square = square + wide_product(a[item, TRIAL, i], a[item, TRIAL, i], zero)
        for k in range(9):
            a[item, PART, k] = _three(a, item, TRIAL, k // 3 * 3, 1, TRIAL, k % 3 * 3, 1, zero)
        for k in range(9):
            a[item, MOVED, k] = _three(a, item, PART, k // 3 * 3, 1, TRIAL, k % 3, 3, zero)
        e = f64x9(0.0)
        for i in ti.static(range(9)):
            e[i] = wide_product(1.5, a[item, TRIAL, i], zero) - a[item, MOVED, i] / square
        c = epipolar.cofactors(e, zero)
        square = 0.0
        for i in ti.static(range(9)):
            square = square + wide_product(c[i], c[i], zero)
        for i in ti.static(range(3)):
            determinant = determinant + wide_product(e[i], c[i], zero)
        share = determinant / square
        for i in ti.static(range(9)):
            a[item, TRIAL, i] = e[i] - wide_product(share, c[i], zero)


@ti.func
def equations(
    sums: f64_3, cameras: f64_2, pair: ti.i32, trial: f64_2, item: ti.i32, a: f64_3, zero: ti.i32
) -> ti.f64:
    """Set up a step, a turn of E from either side; return the trace of its equations."""
    for k in range(36):
        a[item, MATRICES + k // 9, k % 9] = cameras[pair, k]
    for k in range(9):
        a[item, MOVED, k] = trial[item, k]
    between(a, item, MATRICES + 3, MOVED, MATRICES + 2, PART, TRIAL, zero)
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        for i in range(3):
            a[item, MOVES + k, 3 * k + i] = 0.0
            a[item, MOVES + 3 + k, 3 * i + k] = 0.0
            a[item, MOVES + k, 3 * p + i] = -a[item, TRIAL, 3 * q + i]
            a[item, MOVES + k, 3 * q + i] = a[item, TRIAL, 3 * p + i]
            a[item, MOVES + 3 + k, 3 * i + p] = a[item, TRIAL, 3 * i + q]
            a[item, MOVES + 3 + k, 3 * i + q] = -a[item, TRIAL, 3 * i + p]
    for k in range(6):
        between(a, item, MATRICES + 1, MOVES + k, MATRICES, PART, SLOPES + k, zero)
    trace = ti.f64(0.0)
    for k in range(6):
        right = ti.f64(0.0)
        for i in range(9):
            total = ti.f64(0.0)
            for j in range(9):
                low, high = ti.min(i, j), ti.max(i, j)
                at = 9 * low - low * (low - 1) // 2 + high - low
                total = total + wide_product(sums[item, at, 0], a[item, SLOPES + k, j], zero)
            a[item, PRODUCTS + k, i] = total
            right = right + wide_product(a[item, SLOPES + k, i], sums[item, 45 + i, 0], zero)
        for other in range(6):
            total = ti.f64(0.0)
            for i in range(9):
                total = total + wide_product(
                    a[item, SLOPES + other, i], a[item, PRODUCTS + k, i], zero
                )
            a[item, k, other] = total
        a[item, k, 9] = -right
        trace = trace + a[item, k, k]
    held = wide_product(ti.f64(1e-9), trace, zero)
    for k in range(6):
        a[item, k, k] = a[item, k, k] + held
    return trace


@ti.func
def move(a: f64_3, item: ti.i32, trial: f64_2, zero: ti.i32) -> ti.i32:
    """Turn E by the solution, whose scratch is that of `equations`; tell whether that can be."""
    for k in range(6):
        for i in range(9):
            more = wide_product(a[item, 9, k], a[item, MOVES + k, i], zero)
            a[item, TRIAL, i] = a[item, TRIAL, i] + more
    _polish(a, item, zero)
    between(a, item, MATRICES + 1, TRIAL, MATRICES, PART, MOVED, zero)
    found = epipolar.unit(a, item, MOVED)
    if found:
        for k in range(9):
            trial[item, k] = a[item, MOVED, k]
    return found
