"""The Schur complement of bundle adjustment, in Taichi: equations of the views without the points.

Sighting o has the residual r, the weight w, the derivatives A (2, 3) by its point p and B (2, K) by
the parameters of its view. V_p is the sum of w A^T A over the sightings of p, with its diagonal
damped, and y_p = V_p^-1 times the sum of w A^T r. Then the views c and d have the equations

    S_cd = [c = d] sum_c w B^T B - sum over the points p of both: (w B^T A)_c V_p^-1 (w A^T B)_d
    g_c = sum_c w B^T r - sum_c w B^T A y_p

(B. Triggs, P. McLauchlan, R. Hartley and A. Fitzgibbon, "Bundle adjustment: a modern synthesis",
2000, section 6.1). Only pairs of views that see the same points have a block. A thread has one
parameter of a view: a row of all blocks of this view.
"""

import taichi as ti

f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.kernel
def fill_rows(
    slopes: f64_3,
    weights: f64_1,
    ends: i32_2,
    spans: i32_2,
    order: i32_1,
    ranges: i32_2,
    inverses: f64_2,
    number: i32_2,
    # outputs
    system: f64_3,
):
    """Write row r of each block S_cd, d >= c."""
    for item in range(number.shape[0] * system.shape[1]):
        size = system.shape[1]
        c = item // size
        r = item - c * size
        for other in range(c, number.shape[1]):
            b = number[c, other]
            if b >= 0:
                for s in range(size):
                    system[b, r, s] = ti.f64(0.0)
        own = number[c, c]
        for place in range(ranges[c, 0], ranges[c, 0] + ranges[c, 1]):
            o = order[place]
            p = ends[o, 2]
            w = weights[o]
            up = w * slopes[o, 0, 3 + r]
            down = w * slopes[o, 1, 3 + r]
            for s in range(size):
                here = up * slopes[o, 0, 3 + s] + down * slopes[o, 1, 3 + s]
                system[own, r, s] = system[own, r, s] + here
            x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
            y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
            z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
            i = inverses[p, 0] * x + inverses[p, 1] * y + inverses[p, 2] * z
            j = inverses[p, 1] * x + inverses[p, 3] * y + inverses[p, 4] * z
            k = inverses[p, 2] * x + inverses[p, 4] * y + inverses[p, 5] * z
            for q in range(spans[p, 0], spans[p, 0] + spans[p, 1]):
                d = ends[q, 0]
                if d >= c:
                    b = number[c, d]
                    up = weights[q] * (
                        slopes[q, 0, 0] * i + slopes[q, 0, 1] * j + slopes[q, 0, 2] * k
                    )
                    down = weights[q] * (
                        slopes[q, 1, 0] * i + slopes[q, 1, 1] * j + slopes[q, 1, 2] * k
                    )
                    for s in range(size):
                        there = up * slopes[q, 0, 3 + s] + down * slopes[q, 1, 3 + s]
                        system[b, r, s] = system[b, r, s] - there


@ti.kernel
def gather(
    slopes: f64_3,
    gaps: f64_2,
    weights: f64_1,
    ends: i32_2,
    order: i32_1,
    ranges: i32_2,
    pulls: f64_2,
    # outputs
    right: f64_2,
    sizes: f64_2,
):
    """Write g_c, and the diagonal of the sum of w B^T B."""
    for item in range(right.shape[0] * right.shape[1]):
        size = right.shape[1]
        c = item // size
        r = item - c * size
        gradient = ti.f64(0.0)
        diagonal = ti.f64(0.0)
        for place in range(ranges[c, 0], ranges[c, 0] + ranges[c, 1]):
            o = order[place]
            p = ends[o, 2]
            w = weights[o]
            up = w * slopes[o, 0, 3 + r]
            down = w * slopes[o, 1, 3 + r]
            gradient += up * gaps[o, 0] + down * gaps[o, 1]
            diagonal += up * slopes[o, 0, 3 + r] + down * slopes[o, 1, 3 + r]
            x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
            y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
            z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
            gradient -= x * pulls[p, 0] + y * pulls[p, 1] + z * pulls[p, 2]
        right[c, r] = gradient
        sizes[c, r] = diagonal
