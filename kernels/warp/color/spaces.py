"""Curves and matrices of colour spaces, in Warp, with one thread a pixel.

The Taichi set has the equations.
"""

import warp as wp

from cvkern.kernels.codes import color as codes
from cvkern.kernels.codes.color import BINS, Form
from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LOW = wp.constant(codes.SRGB_LOW)
_SLOPE = wp.constant(codes.SRGB_SLOPE)
_SHIFT = wp.constant(codes.SRGB_SHIFT)
_SCALE = wp.constant(codes.SRGB_SCALE)
_POWER = wp.constant(codes.SRGB_POWER)
_ROOT = wp.constant(1 / codes.SRGB_POWER)
_KNEE = wp.constant(codes.SRGB_LOW * codes.SRGB_SLOPE)
_LAB_LOW = wp.constant(codes.LAB_LOW)
_LAB_KNEE = wp.constant(codes.LAB_LOW ** (1 / 3))
_LAB_SLOPE = wp.constant(codes.LAB_SLOPE)
_LAB_SHIFT = wp.constant(codes.LAB_SHIFT)
_DEGREES = wp.constant(codes.DEGREES)
_BINS = wp.constant(float(BINS))


def convert(colours: wp.array, source: int, target: int, numbers: wp.array, out: wp.array) -> None:
    """Undo the source's curve, multiply by the matrix, and apply the target's curve.

    `numbers` are the matrix, row by row, and what values are multiplied by first.
    """
    inputs = [colours, source, target, numbers]
    launch_each(_convert, out.shape[0], 30 * out.shape[0], inputs, [out])


def encode(
    colours: wp.array,
    source: int,
    numbers: wp.array,
    thresholds: wp.array,
    codes: wp.array,
    out: wp.array,
) -> None:
    """Do the same to sRGB of 8 bits, whose steps up are at the thresholds."""
    inputs = [colours, source, numbers, thresholds, codes]
    launch_each(_encode, out.shape[0], 20 * out.shape[0], inputs, [out])


@wp.func
def _linear(v: float):
    # No power is taken of what is below the knee. What is not a number stays so on either way.
    curved = wp.pow((wp.max(v, _KNEE) + _SHIFT) / _SCALE, _POWER)
    return wp.where(v > _KNEE, curved, v / _SLOPE)


@wp.func
def _curved(v: float):
    curved = _SCALE * wp.pow(wp.max(v, _LOW), _ROOT) - _SHIFT
    return wp.where(v > _LOW, curved, v * _SLOPE)


@wp.func
def _cubed(f: float):
    return wp.where(f > _LAB_KNEE, f * f * f, (f - _LAB_SHIFT) / _LAB_SLOPE)


@wp.func
def _rooted(t: float):
    root = wp.pow(wp.max(t, _LAB_LOW), 1.0 / 3.0)
    return wp.where(t > _LAB_LOW, root, _LAB_SLOPE * t + _LAB_SHIFT)


@wp.func
def _mixed(colours: wp.array2d[float], i: int, source: int, numbers: wp.array[float]):
    v = wp.vec3(colours[i, 0], colours[i, 1], colours[i, 2]) * numbers[9]
    if source == wp.static(int(Form.SRGB)):
        v = wp.vec3(_linear(v[0]), _linear(v[1]), _linear(v[2]))
    if source >= wp.static(int(Form.LAB)):
        a = v[1]
        b = v[2]
        if source == wp.static(int(Form.LCH)):
            a = v[1] * wp.cos(v[2] / _DEGREES)
            b = v[1] * wp.sin(v[2] / _DEGREES)
        f = (v[0] + 16.0) / 116.0
        v = wp.vec3(_cubed(f + a / 500.0), _cubed(f), _cubed(f - b / 200.0))
    return wp.vec3(
        numbers[0] * v[0] + numbers[1] * v[1] + numbers[2] * v[2],
        numbers[3] * v[0] + numbers[4] * v[1] + numbers[5] * v[2],
        numbers[6] * v[0] + numbers[7] * v[1] + numbers[8] * v[2],
    )


@wp.kernel
def _convert(
    stride: int,
    first: int,
    last: int,
    colours: wp.array2d[float],
    source: int,
    target: int,
    numbers: wp.array[float],
    # outputs
    out: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        v = _mixed(colours, i, source, numbers)
        if target == wp.static(int(Form.SRGB)):
            v = wp.vec3(_curved(v[0]), _curved(v[1]), _curved(v[2]))
        if target >= wp.static(int(Form.LAB)):
            x = _rooted(v[0])
            y = _rooted(v[1])
            z = _rooted(v[2])
            a = 500.0 * (x - y)
            b = 200.0 * (y - z)
            if target == wp.static(int(Form.LCH)):
                chroma = wp.sqrt(a * a + b * b)
                hue = wp.atan2(b, a) * _DEGREES
                a = chroma
                b = wp.where(hue < 0.0, hue + 360.0, hue)
            v = wp.vec3(116.0 * y - 16.0, a, b)
        out[i, 0] = v[0]
        out[i, 1] = v[1]
        out[i, 2] = v[2]


@wp.kernel
def _encode(
    stride: int,
    first: int,
    last: int,
    colours: wp.array2d[float],
    source: int,
    numbers: wp.array[float],
    thresholds: wp.array[float],
    codes: wp.array[int],
    # outputs
    out: wp.array2d[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        v = _mixed(colours, i, source, numbers)
        for k in range(3):
            value = wp.where(v[k] > 0.0, wp.min(v[k], 1.0), 0.0)
            code = codes[int(value * _BINS)]
            if value >= thresholds[code]:
                code += 1
            out[i, k] = wp.uint8(code)
