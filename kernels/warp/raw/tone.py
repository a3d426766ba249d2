"""Luminance and tone curves, in Warp; the Taichi set has the equations."""

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp._launch import launch, launch_each
from cvkern.kernels.warp._spans import spans
from cvkern.kernels.warp.raw import _tone_cuda
from cvkern.kernels.warp.raw._sums_cpu import add_up

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_EDGE = wp.constant(codes.EDGE)
_RED, _GREEN, _BLUE = (wp.constant(w) for w in codes.LUMINANCE)


def survey(radiance: wp.array, logs: wp.array, sums: wp.array) -> None:
    """Write log2 of the luminance of (H, W, C) radiance, and measure it.

    Sums (SLOTS, 4) hold the sum of seen logarithms, in steps of 1 / STEPS, their number, and the
    largest of 2^32 less and of 2^32 more.
    """
    if logs.device.is_cuda:
        count = _tone_cuda.threads(-(-logs.size // 4))
        launch(_tone_cuda.survey_four, count, [radiance], [logs, sums])
    else:
        luminance(radiance, 0.0, logs)
        add_up(logs, sums)


def luminance(radiance: wp.array, scale: float, out: wp.array) -> None:
    """Write the luminance of (H, W, C) radiance times `scale`, or its log2 with a scale of 0."""
    rows, columns = out.shape
    _luminance.launch(rows, columns, 4 * out.size, [radiance, scale], [out])


def limit(lowest: float, logs: wp.array) -> None:
    """Raise logarithms to the lowest."""
    launch_each(_limit, logs.size, logs.size, [lowest], [logs])


def show(
    radiance: wp.array,
    one: wp.array,
    own: float,
    two: wp.array,
    other: float,
    offset: float,
    out: wp.array,
) -> None:
    """Multiply (H, W, C) radiance by 2 to a weighted sum of two images, and limit it to 1."""
    rows, columns = one.shape
    inputs = [radiance, one, own, two, other, offset]
    if out.device.is_cuda:
        count = _tone_cuda.threads(-(-out.size // 4))
        launch(_tone_cuda.show_four, count, inputs, [out])
    else:
        _show.launch(rows, columns, 8 * one.size, inputs, [out])


def widen(
    centre: wp.array, wider: wp.array, level: float, begun: int, found: wp.array, open: wp.array
) -> None:
    """Take the mean of the next larger surroundings where none so far had an edge."""
    inputs = [centre, wider, level, begun]
    launch_each(_widen, centre.size, 4 * centre.size, inputs, [found, open])


def curve(radiance: wp.array, around: wp.array, scale: float, white: float, out: wp.array) -> None:
    """Apply Reinhard's curve to (N, C) radiance: with surroundings, or with a white above 0."""
    launch_each(_curve, out.shape[0], 8 * out.size, [radiance, around, scale, white], [out])


@spans("_tone.h", 2, **_tone_cuda.NAMES)
def _luminance(
    row: int,
    left: int,
    right: int,
    radiance: wp.array3d[float],
    scale: float,
    out: wp.array2d[float],
): ...


@spans("_tone.h", **_tone_cuda.NAMES)
def _show(
    row: int,
    left: int,
    right: int,
    radiance: wp.array3d[float],
    one: wp.array2d[float],
    own: float,
    two: wp.array2d[float],
    other: float,
    offset: float,
    out: wp.array3d[float],
): ...


@wp.kernel
def _limit(stride: int, first: int, last: int, lowest: float, logs: wp.array[float]):
    for i in range(first + wp.tid(), last, stride):
        logs[i] = wp.max(logs[i], lowest)


@wp.kernel
def _widen(
    stride: int,
    first: int,
    last: int,
    centre: wp.array[float],
    wider: wp.array[float],
    level: float,
    begun: int,
    # outputs
    found: wp.array[float],
    open: wp.array[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        c = centre[i]
        w = wider[i]
        flat = wp.abs(c - w) < _EDGE * (level + c)
        if begun == 0:
            found[i] = c
        if begun != 0 and open[i] == wp.uint8(0):
            flat = False
        open[i] = wp.where(flat, wp.uint8(1), wp.uint8(0))
        if flat:
            found[i] = w


@wp.func
def _seen(v: float):
    return wp.where(v > 0.0 and v < 3.4e38, v, 0.0)


@wp.kernel
def _curve(
    stride: int,
    first: int,
    last: int,
    radiance: wp.array2d[float],
    around: wp.array[float],
    scale: float,
    white: float,
    # outputs
    out: wp.array2d[float],
):
    channels = out.shape[1]
    for i in range(first + wp.tid(), last, stride):
        light = _seen(radiance[i, 0])
        if channels == 3:
            light = (_RED * light + _GREEN * _seen(radiance[i, 1])) + _BLUE * _seen(radiance[i, 2])
        scaled = light * scale
        ratio = float(0.0)
        if white > 0.0:
            ratio = scale * (1.0 + scaled / (white * white)) / (1.0 + scaled)
        else:
            ratio = scale / (1.0 + around[i])
        for c in range(channels):
            out[i, c] = wp.min(_seen(radiance[i, c]) * ratio, 1.0)
