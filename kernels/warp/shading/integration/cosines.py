"""Poisson's equation in a rectangle by cosine transforms, in Warp.

The Taichi set has the equations. Stages of radix 8 compute eight values of a line per thread, those
of other factors one.
"""

import math

import warp as wp

from cvkern.kernels.warp._launch import launch_each, view

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

DIAGONAL = wp.constant(math.sqrt(0.5))


def _complex(array: wp.array) -> wp.array:
    """View an array whose last axis is 2 as complex numbers."""
    return view(array, wp.vec2, array.shape[:-1])


@wp.func
def _place(n: int, count: int):
    """Return the place of value n in Makhoul's order."""
    if n % 2 == 1:
        return count - 1 - n // 2
    return n // 2


@wp.func
def _right_side(slope: wp.array3d[float], y: int, x: int):
    """Return the sum of the rises of the edges that end in a pixel less those that begin there."""
    total = float(0.0)
    if x < slope.shape[2]:
        if x > 0:
            total += 0.5 * (slope[0, y, x - 1] + slope[0, y, x])
        if x + 1 < slope.shape[2]:
            total -= 0.5 * (slope[0, y, x] + slope[0, y, x + 1])
        if y > 0:
            total += 0.5 * (slope[1, y - 1, x] + slope[1, y, x])
        if y + 1 < slope.shape[1]:
            total -= 0.5 * (slope[1, y, x] + slope[1, y + 1, x])
    return total


def begin(slope: wp.array, out: wp.array) -> None:
    """Step 1: write the right side from slopes (3, H, W).

    Rows are in Makhoul's order, and two columns are one complex column.
    """
    pairs = _complex(out)
    launch_each(_begin, pairs.size, 4 * out.size, [slope], [pairs])


@wp.kernel
def _begin(
    stride: int,
    first: int,
    last: int,
    slope: wp.array3d[float],
    # outputs
    out: wp.array2d[wp.vec2],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // out.shape[1]
        j = i % out.shape[1]
        pair = wp.vec2(_right_side(slope, y, 2 * j), _right_side(slope, y, 2 * j + 1))
        out[_place(y, out.shape[0]), j] = pair


@wp.func
def _times(a: wp.vec2, b: wp.vec2):
    return wp.vec2(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


@wp.func
def _turned(a: wp.vec2, sign: float):
    """Return a times sign i."""
    return wp.vec2(-sign * a[1], sign * a[0])


@wp.func
def _four(a: wp.vec2, b: wp.vec2, c: wp.vec2, d: wp.vec2, sign: float):
    """Return the Fourier transform of four numbers."""
    e = a + c
    f = a - c
    g = b + d
    h = _turned(b - d, sign)
    return e + g, f + h, e - g, f - h


@wp.func
def _wave(waves: wp.array[wp.vec2], k: int, sign: float):
    wave = waves[k]
    return wp.vec2(wave[0], sign * wave[1])


@wp.func
def _read(src: wp.array2d[wp.vec2], axis: int, n: int, line: int):
    if axis == 0:
        return src[n, line]
    return src[line, n]


@wp.func
def _store(value: wp.vec2, axis: int, n: int, line: int, out: wp.array2d[wp.vec2]):
    if axis == 0:
        out[n, line] = value
    else:
        out[line, n] = value


def stage(
    src: wp.array,
    waves: wp.array,
    radix: int,
    before: int,
    axis: int,
    sign: float,
    out: wp.array,
) -> None:
    """Do steps 2, 4, 6 and 8: write a stage of Fourier transforms along axis 0 or 1.

    `before` is the product of the factors of earlier stages. The waves (N, 2) are
    ``cos(2 pi k / N)`` and ``sin(2 pi k / N)``; the sign is that of the exponent.
    """
    inputs = [_complex(src), _complex(waves), before, axis, sign]
    pairs = _complex(out)
    if radix == 8:
        launch_each(_stage_of_eight, pairs.size // 8, 8 * out.size, inputs, [pairs])
    else:
        launch_each(_stage, pairs.size, 2 * radix * out.size, [*inputs, radix], [pairs])


@wp.kernel
def _stage(
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
            z = _read(src, axis, begin + t * (count // radix), line)
            total += _times(_wave(waves, wave, sign), z)
            wave += step
            if wave >= count:
                wave -= count
        _store(total, axis, n, line, out)


@wp.kernel
def _stage_of_eight(
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
        a0 = _read(src, axis, m, line)
        a1 = _times(_wave(waves, step, sign), _read(src, axis, m + eighth, line))
        a2 = _times(_wave(waves, 2 * step, sign), _read(src, axis, m + 2 * eighth, line))
        a3 = _times(_wave(waves, 3 * step, sign), _read(src, axis, m + 3 * eighth, line))
        a4 = _times(_wave(waves, 4 * step, sign), _read(src, axis, m + 4 * eighth, line))
        a5 = _times(_wave(waves, 5 * step, sign), _read(src, axis, m + 5 * eighth, line))
        a6 = _times(_wave(waves, 6 * step, sign), _read(src, axis, m + 6 * eighth, line))
        a7 = _times(_wave(waves, 7 * step, sign), _read(src, axis, m + 7 * eighth, line))
        e0, e1, e2, e3 = _four(a0, a2, a4, a6, sign)
        o0, o1, o2, o3 = _four(a1, a3, a5, a7, sign)
        o1 = _times(wp.vec2(DIAGONAL, sign * DIAGONAL), o1)
        o2 = _turned(o2, sign)
        o3 = _times(wp.vec2(-DIAGONAL, sign * DIAGONAL), o3)
        at = (m - k) * 8 + k
        _store(e0 + o0, axis, at, line, out)
        _store(e1 + o1, axis, at + before, line, out)
        _store(e2 + o2, axis, at + 2 * before, line, out)
        _store(e3 + o3, axis, at + 3 * before, line, out)
        _store(e0 - o0, axis, at + 4 * before, line, out)
        _store(e1 - o1, axis, at + 5 * before, line, out)
        _store(e2 - o2, axis, at + 6 * before, line, out)
        _store(e3 - o3, axis, at + 7 * before, line, out)


@wp.func
def _apart(z: wp.vec2, y: wp.vec2):
    """Return the transforms of two real lines at k, from the complex one at k and N - k."""
    return wp.vec4(z[0] + y[0], z[1] - y[1], z[1] + y[1], y[0] - z[0]) * 0.5


def across(src: wp.array, quarters: wp.array, out: wp.array) -> None:
    """Step 3: finish the cosine transforms along columns.

    Columns are then in Makhoul's order, and two rows are one complex row.

    The quarters (H, 2) are ``cos(pi k / 2H)`` and ``sin(pi k / 2H)``.
    """
    inputs = [_complex(src), _complex(quarters)]
    launch_each(_across, out.shape[0] * src.shape[1], 2 * out.size, inputs, [_complex(out)])


@wp.func
def _cosines_of(src: wp.array2d[wp.vec2], quarters: wp.array[wp.vec2], k: int, j: int):
    """Return the cosine transforms of a pair of columns at k, 0 behind the last."""
    height = src.shape[0]
    if k >= height:
        return wp.vec2()
    v = _apart(src[k, j], src[(height - k) % height, j])
    q = quarters[k]
    return wp.vec2(q[0] * v[0] + q[1] * v[1], q[0] * v[2] + q[1] * v[3])


@wp.kernel
def _across(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    quarters: wp.array[wp.vec2],
    # outputs
    out: wp.array2d[wp.vec2],
):
    width = out.shape[1]
    for n in range(first + wp.tid(), last, stride):
        i = n // src.shape[1]
        j = n % src.shape[1]
        a = _cosines_of(src, quarters, 2 * i, j)
        b = _cosines_of(src, quarters, 2 * i + 1, j)
        out[i, _place(2 * j, width)] = wp.vec2(a[0], b[0])
        if 2 * j + 1 < width:
            out[i, _place(2 * j + 1, width)] = wp.vec2(a[1], b[1])


@wp.func
def _share(down: float, along: float, size: float):
    """Return 1 over an eigenvalue times the number of pixels, or 0 for the mean."""
    share = float(0.0)
    if down + along > 0.0:
        share = 1.0 / (size * (down + along))
    return share


@wp.func
def _together(q: wp.vec2, at: wp.vec4):
    """Return a complex transform at k and N - k, from values of two real lines at k and N - k."""
    a = wp.vec2(q[0] * at[0] + q[1] * at[1], q[1] * at[0] - q[0] * at[1])
    b = wp.vec2(q[0] * at[2] + q[1] * at[3], q[1] * at[2] - q[0] * at[3])
    return wp.vec4(a[0] - b[1], a[1] + b[0], a[0] + b[1], b[0] - a[1])


def divide(
    src: wp.array, quarters: wp.array, down: wp.array, along: wp.array, out: wp.array
) -> None:
    """Step 5: finish the transforms along rows, divide, and begin the inverse ones along rows.

    The divisors are the eigenvalues times the number of pixels.

    The parts of the eigenvalues are ``4 sin^2(pi k / 2H)`` down, (H,), and the like along, (W,).
    """
    inputs = [_complex(src), _complex(quarters), down, along]
    count = out.shape[0] * (out.shape[1] // 2 + 1)
    launch_each(_divide, count, 2 * out.size, inputs, [_complex(out)])


@wp.kernel
def _divide(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    quarters: wp.array[wp.vec2],
    down: wp.array[float],
    along: wp.array[float],
    # outputs
    out: wp.array2d[wp.vec2],
):
    width = src.shape[1]
    half = width // 2 + 1
    size = float(down.shape[0]) * float(width)
    for n in range(first + wp.tid(), last, stride):
        i = n // half
        k = n % half
        other = (width - k) % width
        v = _apart(src[i, k], src[i, other])
        q = quarters[k]
        one = down[2 * i]
        two = down[wp.min(2 * i + 1, down.shape[0] - 1)]
        at = wp.vec4()
        at[0] = (q[0] * v[0] + q[1] * v[1]) * _share(one, along[k], size)
        at[2] = (q[0] * v[2] + q[1] * v[3]) * _share(two, along[k], size)
        if k > 0:
            at[1] = (q[1] * v[0] - q[0] * v[1]) * _share(one, along[other], size)
            at[3] = (q[1] * v[2] - q[0] * v[3]) * _share(two, along[other], size)
        z = _together(q, at)
        out[i, k] = wp.vec2(z[0], z[1])
        if other != k:
            out[i, other] = wp.vec2(z[2], z[3])


@wp.func
def _placed(src: wp.array2d[wp.vec2], k: int, height: int, x: int):
    """Return a value of pairs of rows, 0 outside of the image."""
    if k >= height or x >= src.shape[1]:
        return 0.0
    pair = src[k // 2, _place(x, src.shape[1])]
    return wp.where(k % 2 == 0, pair[0], pair[1])


def back(src: wp.array, quarters: wp.array, out: wp.array) -> None:
    """Step 7: begin the inverse transforms along columns; those along rows are done."""
    inputs = [_complex(src), _complex(quarters)]
    count = (out.shape[0] // 2 + 1) * out.shape[1]
    launch_each(_back, count, 2 * out.size, inputs, [_complex(out)])


@wp.kernel
def _back(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    quarters: wp.array[wp.vec2],
    # outputs
    out: wp.array2d[wp.vec2],
):
    height = out.shape[0]
    for n in range(first + wp.tid(), last, stride):
        k = n // out.shape[1]
        j = n % out.shape[1]
        at = wp.vec4(
            _placed(src, k, height, 2 * j),
            _placed(src, height - k, height, 2 * j),
            _placed(src, k, height, 2 * j + 1),
            _placed(src, height - k, height, 2 * j + 1),
        )
        z = _together(quarters[k], at)
        other = (height - k) % height
        out[k, j] = wp.vec2(z[0], z[1])
        if other != k:
            out[other, j] = wp.vec2(z[2], z[3])


def end(src: wp.array, depth: wp.array) -> None:
    """Step 9: write the depth; rows were in Makhoul's order, and two columns were one."""
    launch_each(_end, depth.size, depth.size, [_complex(src)], [depth])


@wp.kernel
def _end(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[wp.vec2],
    # outputs
    depth: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // depth.shape[1]
        x = i % depth.shape[1]
        pair = src[_place(y, depth.shape[0]), x // 2]
        depth[y, x] = wp.where(x % 2 == 0, pair[0], pair[1])
