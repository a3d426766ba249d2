"""Poisson's equation in a rectangle by cosine transforms, in Warp.

The Taichi set has the equations.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each, view

from . import _stages as stages

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)


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
    """Write the right side of slopes (3, H, W): rows in Makhoul's order, pairs of columns."""
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


def stage(
    src: wp.array,
    waves: wp.array,
    radix: int,
    before: int,
    axis: int,
    sign: float,
    out: wp.array,
) -> None:
    """Write a stage of Fourier transforms along axis 0 or 1, after others of the product `before`.

    The waves (N, 2) are ``cos(2 pi k / N)`` and ``sin(2 pi k / N)``; the sign is that of the
    exponent.
    """
    inputs = [_complex(src), _complex(waves), before, axis, sign]
    pairs = _complex(out)
    if radix == 16:
        launch_each(stages.stage_of_sixteen, pairs.size // 16, 16 * out.size, inputs, [pairs])
    elif radix == 8:
        launch_each(stages.stage_of_eight, pairs.size // 8, 8 * out.size, inputs, [pairs])
    else:
        launch_each(stages.stage, pairs.size, 2 * radix * out.size, [*inputs, radix], [pairs])


@wp.func
def _apart(z: wp.vec2, y: wp.vec2):
    """Return the transforms of two real lines at k, from the complex one at k and N - k."""
    return wp.vec4(z[0] + y[0], z[1] - y[1], z[1] + y[1], y[0] - z[0]) * 0.5


def across(src: wp.array, quarters: wp.array, out: wp.array) -> None:
    """Write cosine transforms along columns: columns in Makhoul's order, pairs of rows.

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
    """Return one over an eigenvalue times the number of pixels, 0 for the mean."""
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
    """Finish cosine transforms along rows, divide by eigenvalues and pixels, begin the inverse.

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
    """Begin the inverse transforms along columns, of pairs of rows whose own are done."""
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
    """Write depth of rows in Makhoul's order and pairs of columns."""
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
