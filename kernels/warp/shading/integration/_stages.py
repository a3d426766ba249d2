"""Stages of Fourier transforms of lines, in Warp.

Stages of radix 16 and 8 compute as many values of a line per thread, those of other factors one.
"""

import math

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DIAGONAL = wp.constant(math.sqrt(0.5))
COSINE, SINE = (wp.constant(f(math.pi / 8)) for f in (math.cos, math.sin))


@wp.func
def product(a: wp.vec2, b: wp.vec2):
    return wp.vec2(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


@wp.func
def turned(a: wp.vec2, sign: float):
    """Return a times sign i."""
    return wp.vec2(-sign * a[1], sign * a[0])


@wp.func
def four_of(a: wp.vec2, b: wp.vec2, c: wp.vec2, d: wp.vec2, sign: float):
    """Return the Fourier transform of four numbers."""
    e = a + c
    f = a - c
    g = b + d
    h = turned(b - d, sign)
    return e + g, f + h, e - g, f - h


@wp.func
def wave_at(waves: wp.array[wp.vec2], k: int, sign: float):
    wave = waves[k]
    return wp.vec2(wave[0], sign * wave[1])


@wp.func
def read_at(src: wp.array2d[wp.vec2], axis: int, n: int, line: int):
    if axis == 0:
        return src[n, line]
    return src[line, n]


@wp.func
def store_at(value: wp.vec2, axis: int, n: int, line: int, out: wp.array2d[wp.vec2]):
    if axis == 0:
        out[n, line] = value
    else:
        out[line, n] = value


@wp.kernel
def stage(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    waves: wp.array[wp.vec2],
    before: int,
    axis: int,
    sign: float,
    radix: int,
    # outputs
    out: wp.array2d[wp.vec2],
):
    count = waves.shape[0]
    for i in range(first + wp.tid(), last, stride):
        n = i // src.shape[1]
        line = i % src.shape[1]
        if axis == 1:
            n = i % src.shape[1]
            line = i // src.shape[1]
        turn = n % (before * radix)
        begin = n // (before * radix) * before + turn % before
        step = turn * (count // (before * radix))
        total = wp.vec2()
        wave = int(0)
        for t in range(radix):
            z = read_at(src, axis, begin + t * (count // radix), line)
            total += product(wave_at(waves, wave, sign), z)
            wave += step
            if wave >= count:
                wave -= count
        store_at(total, axis, n, line, out)


@wp.kernel
def stage_of_eight(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    waves: wp.array[wp.vec2],
    before: int,
    axis: int,
    sign: float,
    # outputs
    out: wp.array2d[wp.vec2],
):
    eighth = waves.shape[0] // 8
    for i in range(first + wp.tid(), last, stride):
        m = i // src.shape[1]
        line = i % src.shape[1]
        if axis == 1:
            m = i % eighth
            line = i // eighth
        k = m % before
        step = k * (eighth // before)
        a0 = read_at(src, axis, m, line)
        a1 = product(wave_at(waves, step, sign), read_at(src, axis, m + eighth, line))
        a2 = product(wave_at(waves, 2 * step, sign), read_at(src, axis, m + 2 * eighth, line))
        a3 = product(wave_at(waves, 3 * step, sign), read_at(src, axis, m + 3 * eighth, line))
        a4 = product(wave_at(waves, 4 * step, sign), read_at(src, axis, m + 4 * eighth, line))
        a5 = product(wave_at(waves, 5 * step, sign), read_at(src, axis, m + 5 * eighth, line))
        a6 = product(wave_at(waves, 6 * step, sign), read_at(src, axis, m + 6 * eighth, line))
        a7 = product(wave_at(waves, 7 * step, sign), read_at(src, axis, m + 7 * eighth, line))
        e0, e1, e2, e3 = four_of(a0, a2, a4, a6, sign)
        o0, o1, o2, o3 = four_of(a1, a3, a5, a7, sign)
        o1 = product(wp.vec2(DIAGONAL, sign * DIAGONAL), o1)
        o2 = turned(o2, sign)
        o3 = product(wp.vec2(-DIAGONAL, sign * DIAGONAL), o3)
        at = (m - k) * 8 + k
        store_at(e0 + o0, axis, at, line, out)
        store_at(e1 + o1, axis, at + before, line, out)
        store_at(e2 + o2, axis, at + 2 * before, line, out)
        store_at(e3 + o3, axis, at + 3 * before, line, out)
        store_at(e0 - o0, axis, at + 4 * before, line, out)
        store_at(e1 - o1, axis, at + 5 * before, line, out)
        store_at(e2 - o2, axis, at + 6 * before, line, out)
        store_at(e3 - o3, axis, at + 7 * before, line, out)


@wp.func
def turn_to(
    src: wp.array2d[wp.vec2],
    waves: wp.array[wp.vec2],
    axis: int,
    n: int,
    line: int,
    wave: int,
    sign: float,
):
    """Return value n of a line, times a wave."""
    return product(wave_at(waves, wave, sign), read_at(src, axis, n, line))


@wp.func
def store_four(
    a: wp.vec2,
    b: wp.vec2,
    c: wp.vec2,
    d: wp.vec2,
    sign: float,
    axis: int,
    at: int,
    apart: int,
    line: int,
    out: wp.array2d[wp.vec2],
):
    """Write the Fourier transform of four numbers to places of a line."""
    e, f, g, h = four_of(a, b, c, d, sign)
    store_at(e, axis, at, line, out)
    store_at(f, axis, at + apart, line, out)
    store_at(g, axis, at + 2 * apart, line, out)
    store_at(h, axis, at + 3 * apart, line, out)


@wp.kernel
def stage_of_sixteen(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    waves: wp.array[wp.vec2],
    before: int,
    axis: int,
    sign: float,
    # outputs
    out: wp.array2d[wp.vec2],
):
    part = waves.shape[0] // 16
    for i in range(first + wp.tid(), last, stride):
        m = i // src.shape[1]
        line = i % src.shape[1]
        if axis == 1:
            m = i % part
            line = i // part
        k = m % before
        step = k * (part // before)
        a0 = turn_to(src, waves, axis, m + 0 * part, line, 0 * step, sign)
        a1 = turn_to(src, waves, axis, m + 1 * part, line, 1 * step, sign)
        a2 = turn_to(src, waves, axis, m + 2 * part, line, 2 * step, sign)
        a3 = turn_to(src, waves, axis, m + 3 * part, line, 3 * step, sign)
        a4 = turn_to(src, waves, axis, m + 4 * part, line, 4 * step, sign)
        a5 = turn_to(src, waves, axis, m + 5 * part, line, 5 * step, sign)
        a6 = turn_to(src, waves, axis, m + 6 * part, line, 6 * step, sign)
        a7 = turn_to(src, waves, axis, m + 7 * part, line, 7 * step, sign)
        a8 = turn_to(src, waves, axis, m + 8 * part, line, 8 * step, sign)
        a9 = turn_to(src, waves, axis, m + 9 * part, line, 9 * step, sign)
        a10 = turn_to(src, waves, axis, m + 10 * part, line, 10 * step, sign)
        a11 = turn_to(src, waves, axis, m + 11 * part, line, 11 * step, sign)
        a12 = turn_to(src, waves, axis, m + 12 * part, line, 12 * step, sign)
        a13 = turn_to(src, waves, axis, m + 13 * part, line, 13 * step, sign)
        a14 = turn_to(src, waves, axis, m + 14 * part, line, 14 * step, sign)
        a15 = turn_to(src, waves, axis, m + 15 * part, line, 15 * step, sign)
        # Four transforms of every fourth value, which are turned, and four transforms of those.
        e0, e1, e2, e3 = four_of(a0, a4, a8, a12, sign)
        f0, f1, f2, f3 = four_of(a1, a5, a9, a13, sign)
        g0, g1, g2, g3 = four_of(a2, a6, a10, a14, sign)
        h0, h1, h2, h3 = four_of(a3, a7, a11, a15, sign)
        one = wp.vec2(COSINE, sign * SINE)
        two = wp.vec2(DIAGONAL, sign * DIAGONAL)
        three = wp.vec2(SINE, sign * COSINE)
        six = wp.vec2(-DIAGONAL, sign * DIAGONAL)
        nine = wp.vec2(-COSINE, -(sign * SINE))
        f1 = product(one, f1)
        f2 = product(two, f2)
        f3 = product(three, f3)
        g1 = product(two, g1)
        g2 = turned(g2, sign)
        g3 = product(six, g3)
        h1 = product(three, h1)
        h2 = product(six, h2)
        h3 = product(nine, h3)
        at = (m - k) * 16 + k
        store_four(e0, f0, g0, h0, sign, axis, at, 4 * before, line, out)
        store_four(e1, f1, g1, h1, sign, axis, at + before, 4 * before, line, out)
        store_four(e2, f2, g2, h2, sign, axis, at + 2 * before, 4 * before, line, out)
        store_four(e3, f3, g3, h3, sign, axis, at + 3 * before, 4 * before, line, out)
