"""Equations of the views without points, in Taichi: a thread a parameter of a view."""

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
    """Write the rows of the blocks."""
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
    """Write the gradient, and the diagonal before points were eliminated."""
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
