"""Curves and matrices of colour spaces, in Warp, with one thread a pixel, or four of sRGB in bytes.

The Taichi set has the equations.
"""

import warp as wp

from cvkern.kernels.codes import color as codes
from cvkern.kernels.codes.color import DARKEST, FIRST, Form
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp.color import _spaces_cuda
from cvkern.kernels.warp.color._spaces_cpu import encode_linear

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
_DARKEST = wp.constant(DARKEST)
_FIRST = wp.constant(FIRST)


def convert(colours: wp.array, source: int, target: int, numbers: wp.array, out: wp.array) -> None:
    """Undo the source's curve, multiply by the matrix, and apply the target's curve.

    `numbers` are the matrix, row by row, and what values are multiplied by first.
    """
    inputs = [colours, source, target, numbers]
    launch_each(_convert, out.shape[0], 30 * out.shape[0], inputs, [out])


def encode(
    colours: wp.array, source: int, numbers: wp.array, steps: wp.array, out: wp.array
) -> None:
    """Do the same to sRGB of 8 bits, with a table of its steps up."""
    inputs = [source, numbers, steps]
    count = out.shape[0]
    aligned = count % 4 == 0 and colours.ptr % 16 == 0 and out.ptr % 4 == 0
    if out.device.is_cuda and aligned and source == Form.LINEAR:
        threads = _spaces_cuda.threads(count // 4)
        given = [colours, numbers, steps]
        launch(_spaces_cuda.encode_four, threads, given, [out], _spaces_cuda.BLOCK)
    elif out.device.is_cuda or source != Form.LINEAR:
        launch_each(_encode, count, 20 * count, [colours, *inputs], [out])
    else:
        launch_slabs(encode_linear, count, slabs(count, count), [colours, numbers, steps], [out])


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
def _mixed(given: wp.vec3, source: int, numbers: wp.array[float]):
    v = given * numbers[9]
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
        given = wp.vec3(colours[i, 0], colours[i, 1], colours[i, 2])
        v = _mixed(given, source, numbers)
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


@wp.func
def _code(v: float, steps: wp.array[int]):
    value = wp.where(v > _DARKEST, wp.min(v, 1.0), _DARKEST)
    bits = wp.cast(value, wp.int32)
    return (steps[(bits >> 16) - _FIRST] + (bits & 0xFFFF)) >> 16


@wp.kernel
def _encode(
    stride: int,
    first: int,
    last: int,
    colours: wp.array2d[float],
    source: int,
    numbers: wp.array[float],
    steps: wp.array[int],
    # outputs
    out: wp.array2d[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        given = wp.vec3(colours[i, 0], colours[i, 1], colours[i, 2])
        v = _mixed(given, source, numbers)
        for k in range(3):
            out[i, k] = wp.uint8(_code(v[k], steps))
