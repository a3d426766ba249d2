"""What estimates of the light are made of, in Warp: block means of the pixels that count.

A pixel counts if it is finite, marked, dark enough not to be saturated, and above black in all
channels; a block counts if all its pixels do. Sums are in float64, in order. One thread takes a
block, or every so many pixels; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.codes.color import SATURATED, SLOTS
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._order import ordered

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_THREADS = 2**16  # threads of CUDA that compare values
_SLOTS = wp.constant(SLOTS)
_SATURATED = wp.constant(wp.float64(SATURATED))


def peak(image: wp.array, keys: wp.array) -> None:
    """Find the largest value of (N, 3) finite pixels, as SLOTS keys.

    A key is the bits as an integer of the same order, plus 2^32; 0 stands for no pixel.
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
            bits = wp.cast(wp.max(wp.max(a, b), c), wp.int32)
            best = wp.max(best, wp.int64(ordered(bits)) + wp.int64(4294967296))
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
    values: wp.array3d[wp.float64],
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
            values[y, x, c] = sums[c] * share
        valid[y, x] = wp.where(good, wp.uint8(1), wp.uint8(0))
