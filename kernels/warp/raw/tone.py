"""Luminance and tone curves, in Warp; the Taichi set has the equations."""

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._spans import spans

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_THREADS = 2**17  # threads of CUDA that add values up
_SLOTS, _STEPS = wp.constant(codes.SLOTS), wp.constant(float(codes.STEPS))
_EDGE = wp.constant(codes.EDGE)
_RED, _GREEN, _BLUE = (wp.constant(w) for w in codes.LUMINANCE)
_NAMES = dict(zip(("RED", "GREEN", "BLUE"), (f"{w!r}f" for w in codes.LUMINANCE), strict=True))
_NAMES["UNSEEN"] = f"{codes.UNSEEN!r}f"


def luminance(radiance: wp.array, scale: float, out: wp.array) -> None:
    """Write the luminance of (H, W, C) radiance times `scale`, or its log2 with a scale of 0."""
    rows, columns = out.shape
    _luminance.launch(rows, columns, 4 * out.size, [radiance, scale], [out])


def measure(logs: wp.array, sums: wp.array) -> None:
    """Add up seen logarithms, in (SLOTS, 4) sums, count them, and find both ends.

    In steps of 1 / STEPS. Ends are written as the largest of 2^32 less, and of 2^32 more.
    """
    if logs.device.is_cuda:
        launch(_measure, min(_THREADS, logs.size), [0, 0, logs.size, _THREADS, logs], [sums])
    else:
        launch_slabs(_measure, logs.size, slabs(logs.size, logs.size), [1, logs], [sums])


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


@spans("_tone.h", 2, **_NAMES)
def _luminance(
    row: int,
    left: int,
    right: int,
    radiance: wp.array3d[float],
    scale: float,
    out: wp.array2d[float],
): ...


@spans("_tone.h", 1, **_NAMES)
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
def _measure(
    slab: int,
    first: int,
    last: int,
    stride: int,
    logs: wp.array[float],
    # outputs
    sums: wp.array2d[wp.int64],
):
    total = wp.int64(0)
    count = wp.int64(0)
    low = wp.int64(0)
    high = wp.int64(0)
    for i in range(first + wp.tid(), last, stride):
        value = logs[i]
        if value > -500.0:
            fixed = wp.int64(wp.floor(value * _STEPS + 0.5))
            total += fixed
            count += wp.int64(1)
            low = wp.max(low, wp.int64(4294967296) - fixed)
            high = wp.max(high, wp.int64(4294967296) + fixed)
    slot = (slab + wp.tid()) % _SLOTS
    if count > wp.int64(0):
        wp.atomic_add(sums, slot, 0, total)
        wp.atomic_add(sums, slot, 1, count)
        wp.atomic_max(sums, slot, 2, low)
        wp.atomic_max(sums, slot, 3, high)


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
