"""What estimates of the light are made of, in Warp: block means of the pixels that count, and maps.

A pixel counts if it is finite, marked, dark enough not to be saturated, and above black in all
channels; a block counts if all its pixels do. Sums are in float64, in order. One thread takes a
block, or every so many pixels; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.codes.color import SATURATED, SLOTS
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._order import key_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_THREADS = 2**16  # threads of CUDA that compare values
_SLOTS = wp.constant(SLOTS)
_SATURATED = wp.constant(wp.float64(SATURATED))


def peak(image: wp.array, keys: wp.array) -> None:
    """Find the largest value of (N, 3) finite pixels, as SLOTS keys.

    Keys are those of `key_of`; 0 stands for no pixel.
    """
    count = image.shape[0]
    if image.device.is_cuda:
        threads = min(_THREADS, count)
        launch(_peak, threads, [0, 0, count, threads, image], [keys])
    else:
        launch_slabs(_peak, count, min(slabs(count, image.size), SLOTS), [1, image], [keys])


def gather(
    image: wp.array,
    mask: wp.array,
    black: float,
    scale: float,
    side: int,
    values: wp.array,
    valid: wp.array,
) -> None:
    """Write means of blocks of a side, less black and scaled, and whether all their pixels count.

    Without a mask that is of shape (0, 0).
    """
    inputs = [image, mask, black, scale, side]
    launch_each(_gather, valid.size, 4 * image.size, inputs, [values, valid])


def inner(valid: wp.array, out: wp.array) -> None:
    """Mark the pixels from which all within three steps, up, down or aside, count."""
    launch_each(_inner, out.size, 24 * out.size, [valid], [out])


def lengths(a: wp.array, b: wp.array, c: wp.array, factor: float, out: wp.array) -> None:
    """Write the roots of a^2 + b^2 + factor c^2 of (N,) values."""
    launch_each(_lengths, out.size, 4 * out.size, [a, b, c, factor], [out])


def contrasts(a: wp.array, b: wp.array, among: wp.array, least: float, out: wp.array) -> None:
    """Mark the pixels among some where a + b exceeds `least` in all of three channels, (N, 3)."""
    launch_each(_contrasts, out.size, 6 * out.size, [a, b, among, least], [out])


def logarithms(means: wp.array, out: wp.array) -> None:
    """Write log2 of red and of blue (N, 3), less that of the sum: (N, 2). None are below 1e-10."""
    launch_each(_logarithms, out.shape[0], 30 * out.size, [means], [out])


def sizes(a: wp.array, b: wp.array, out: wp.array) -> None:
    """Write the lengths of the vectors a + b, (N, 2)."""
    launch_each(_sizes, out.size, 6 * out.size, [a, b], [out])


@wp.kernel
def _peak(
    slab: int,
    first: int,
    last: int,
    stride: int,
    image: wp.array2d[float],
    # outputs
    keys: wp.array[wp.int64],
):
    best = wp.int64(0)
    for i in range(first + wp.tid(), last, stride):
        a = image[i, 0]
        b = image[i, 1]
        c = image[i, 2]
        if wp.isfinite(a) and wp.isfinite(b) and wp.isfinite(c):
            best = wp.max(best, key_of(wp.max(wp.max(a, b), c)))
    wp.atomic_max(keys, (slab + wp.tid()) % _SLOTS, best)


@wp.kernel
def _gather(
    stride: int,
    first: int,
    last: int,
    image: wp.array3d[float],
    mask: wp.array2d[wp.uint8],
    black: wp.float64,
    scale: wp.float64,
    side: int,
    # outputs
    values: wp.array3d[float],
    valid: wp.array2d[wp.uint8],
):
    tall = wp.min(side, image.shape[0])
    wide = wp.min(side, image.shape[1])
    for item in range(first + wp.tid(), last, stride):
        y = item // valid.shape[1]
        x = item - y * valid.shape[1]
        sums = wp.vec3d()
        good = bool(True)
        for j in range(tall):
            for i in range(wide):
                v = y * tall + j
                u = x * wide + i
                if mask.shape[0] > 0:
                    if mask[v, u] == wp.uint8(0):
                        good = False
                finite = bool(True)
                for c in range(3):
                    if not wp.isfinite(image[v, u, c]):
                        finite = False
                if not finite:
                    good = False
                else:
                    for c in range(3):
                        value = (wp.float64(image[v, u, c]) - black) * scale
                        if not (value > wp.float64(0.0) and value < _SATURATED):
                            good = False
                        sums[c] += value
        share = wp.float64(1.0) / wp.float64(tall * wide)
        for c in range(3):
            values[y, x, c] = wp.float32(sums[c] * share)
        valid[y, x] = wp.where(good, wp.uint8(1), wp.uint8(0))


@wp.kernel
def _inner(
    stride: int,
    first: int,
    last: int,
    valid: wp.array2d[wp.uint8],
    # outputs
    out: wp.array2d[wp.uint8],
):
    height = valid.shape[0]
    width = valid.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        good = wp.uint8(1)
        if y < 3 or x < 3 or y >= height - 3 or x >= width - 3:
            good = wp.uint8(0)
        else:
            for j in range(-3, 4):
                wide = 3 - wp.abs(j)
                for i in range(-wide, wide + 1):
                    good = wp.min(good, valid[y + j, x + i])
        out[y, x] = good


@wp.kernel
def _lengths(
    stride: int,
    first: int,
    last: int,
    a: wp.array[float],
    b: wp.array[float],
    c: wp.array[float],
    factor: float,
    # outputs
    out: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        out[i] = wp.sqrt((a[i] * a[i] + b[i] * b[i]) + factor * (c[i] * c[i]))


@wp.kernel
def _contrasts(
    stride: int,
    first: int,
    last: int,
    a: wp.array2d[float],
    b: wp.array2d[float],
    among: wp.array[wp.uint8],
    least: float,
    # outputs
    out: wp.array[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        found = among[i]
        for c in range(3):
            if not (wp.abs(a[i, c] + b[i, c]) > least):
                found = wp.uint8(0)
        out[i] = found


@wp.func
def _log2(x: float):
    """Return the logarithm of x > 0, normal, by the sums of the Taichi set's."""
    bits = wp.cast(x, wp.int32)
    n = (bits - 0x3F3504F3) >> 23
    f = wp.cast(bits - (n << 23), wp.float32) - 1.0
    s = f / (2.0 + f)
    z = s * s
    high = 0.412198583 + z * 0.320598898
    low = 0.961796694 + z * (0.577078016 + z * high)
    return float(n) + s * (2.885390082 + z * low)


@wp.func
def _logarithm(x: float):
    return _log2(wp.max(x, 0.0) + 1.0e-10)


@wp.kernel
def _logarithms(
    stride: int,
    first: int,
    last: int,
    means: wp.array2d[float],
    # outputs
    out: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        total = _logarithm((means[i, 0] + means[i, 1]) + means[i, 2])
        out[i, 0] = _logarithm(means[i, 0]) - total
        out[i, 1] = _logarithm(means[i, 2]) - total


@wp.kernel
def _sizes(
    stride: int,
    first: int,
    last: int,
    a: wp.array2d[float],
    b: wp.array2d[float],
    # outputs
    out: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        u = a[i, 0] + b[i, 0]
        v = a[i, 1] + b[i, 1]
        out[i] = wp.sqrt(u * u + v * v)
