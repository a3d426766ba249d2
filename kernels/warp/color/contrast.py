"""Histograms and tone curves in Warp; the Taichi set has the rules.

On CUDA one thread takes a pixel, and blocks count in shared memory. On the CPU a thread takes a
slab, with histograms of its own; they are added up afterwards.
"""

import numpy as np
import warp as wp

from cvkern.kernels.codes.color import SLOTS, TONES
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._order import key_of
from cvkern.kernels.warp.color import _contrast_cpu as cpu
from cvkern.kernels.warp.color import _contrast_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_TONES = wp.constant(TONES)
_SLOTS = wp.constant(SLOTS)
_THREADS = 2**16  # threads of CUDA that compare levels


def levels(image: wp.array, scale: float, found: wp.array) -> None:
    """Write the largest channel of (N, C) values, C 1 or 3; floats are scaled and rounded."""
    size = found.shape[0]
    if found.device.is_cuda:
        launch(cuda.find_levels[image.dtype], size, [image, scale], [found])
    else:
        kernel = cpu.find_levels[image.dtype]
        launch_slabs(kernel, size, slabs(size, image.size), [image, scale], [found])


def count_levels(found: wp.array, counts: wp.array) -> None:
    """Count how often each level occurs."""
    size = found.shape[0]
    if found.device.is_cuda:
        cuda.count(found, counts)
        return
    number, length = slabs(size, size), counts.shape[0]
    shape = (number, 8 if found.dtype is wp.uint8 else 1, length)
    parts = scratch("contrast.parts", shape, wp.int32, found.device)
    launch_slabs(cpu.count_levels[found.dtype], size, number, [found], [parts])
    np.sum(parts.numpy(), axis=(0, 1), out=counts.numpy())


def extent(found: wp.array, ends: wp.array) -> None:
    """Find the smallest and the largest level; `ends` must begin as (2^16, -1)."""
    size = found.shape[0]
    if found.device.is_cuda:
        threads = min(_THREADS, size)
        launch(cuda.find_extent[found.dtype], threads, [threads, found], [ends])
        return
    number = slabs(size, size)
    parts = scratch("contrast.parts", (number, 2), wp.int32, found.device)
    launch_slabs(cpu.find_extent[found.dtype], size, number, [found], [parts])
    ends.numpy()[...] = parts.numpy()[:, 0].min(), parts.numpy()[:, 1].max()


def survey(image: wp.array, keys: wp.array) -> None:
    """Find both ends of (N,) finite values, and whether there are others: keys (SLOTS, 3).

    Keys are those of `key_of`; that of the least is taken off 2^32, so that all are maxima. The
    last is 1 where a value is not finite.
    """
    count = image.shape[0]
    if image.device.is_cuda:
        threads = min(_THREADS, count)
        launch(_survey, threads, [0, 0, count, threads, image], [keys])
    else:
        launch_slabs(_survey, count, min(slabs(count, count), SLOTS), [1, image], [keys])


def tiles(
    found: wp.array, bins: wp.array, rows: wp.array, columns: wp.array, counts: wp.array
) -> None:
    """Count (R, C, B) the bins of levels in tiles, whose pixels `rows` and `columns` name."""
    inputs = [found, bins, rows, columns]
    tall, wide, length = counts.shape
    size = rows.shape[0] * columns.shape[0]
    if found.device.is_cuda:
        shape = (rows.shape[0], columns.shape[0])
        launch(cuda.count_tiles[found.dtype], shape, inputs, [counts])
        return
    number = slabs(tall * wide, size + 4 * counts.size)
    parts = scratch("contrast.parts", (number, 4, _entries(found, length)), wp.int32, found.device)
    launch_slabs(cpu.count_tiles[found.dtype], tall * wide, number, [*inputs, parts], [counts])


def tone_maps(counts: wp.array, limit: int, scale: float, maps: wp.array) -> None:
    """Cut histograms (T, B) off at a limit, share out the excess, and scale their sums."""
    inputs = [limit, scale]
    launch_each(_tone_maps, counts.shape[0], 8 * counts.size, inputs, [counts, maps])


def blend(
    found: wp.array,
    bins: wp.array,
    maps: wp.array,
    shares: wp.array,
    height: int,
    mixed: wp.array,
) -> None:
    """Mix the tones that the four nearest tiles map a pixel to.

    `shares` are the weights of the lower tiles for each row of one of that height, then of the
    right ones for each column.
    """
    inputs = [found, bins, maps, shares, height]
    if found.device.is_cuda:
        launch(cuda.blend_pixels[found.dtype], found.shape, inputs, [mixed])
    else:
        rows, number = found.shape[0], slabs(found.shape[0], 4 * found.size)
        shape = (number, (maps.shape[1] + 1) * 4 * _entries(found, maps.shape[2]))
        quads = scratch("contrast.parts", shape, wp.int32, found.device)
        kernel = cpu.blend_rows[found.dtype]
        shape = (number, 8 * (shares.shape[0] - height))
        weights = scratch("contrast.weights", shape, wp.float64, found.device)
        launch_slabs(kernel, rows, number, [*inputs, quads, weights], [mixed])


def _entries(found: wp.array, bins: int) -> int:
    """Return how many places a table of a thread has: one a byte, or one a bin."""
    return 256 if found.dtype is wp.uint8 else bins


def look_up(image: wp.array, found: wp.array, table: wp.array, out: wp.array) -> None:
    """Replace the largest channel of (N, C) values by the table's, and scale the others with it.

    C is 1 or 3. Colours as bytes are rounded, and the table holds floats; else its type is theirs.
    """
    size, channels = out.shape
    on = cuda if out.device.is_cuda else cpu
    if channels == 1:
        bits = wp.uint8 if out.dtype is wp.uint8 else wp.int32
        kernel = on.read_table[found.dtype, bits]
        inputs, results = [found, view(table, bits, table.shape)], [view(out, bits, (size,))]
    else:
        kernel = on.scale_colours[image.dtype, out.dtype]
        inputs, results = [image, found, table], [out]
    if out.device.is_cuda:
        launch(kernel, size, inputs, results)
    else:
        launch_slabs(kernel, size, slabs(size, out.size), inputs, results)


def count(image: wp.array, edges: wp.array, counts: wp.array) -> None:
    """Count the values in bins between edges; the last edge belongs to the last bin."""
    size = image.shape[0]
    if image.device.is_cuda and counts.shape[0] <= cuda.BINS:
        cuda.count_values(image, edges, counts)
        return
    if image.device.is_cuda:
        parts = view(counts, wp.int32, (1, counts.shape[0]))
        launch(_count, size, [0, 0, size, size, image, edges], [parts])
        return
    number = slabs(size, size)
    parts = scratch("contrast.parts", (number, counts.shape[0]), wp.int32, image.device)
    parts.zero_()
    launch_slabs(_count, size, number, [1, image, edges], [parts])
    np.sum(parts.numpy(), axis=0, out=counts.numpy())


def curve(
    image: wp.array, centres: wp.array, heights: wp.array, slopes: wp.array, out: wp.array
) -> None:
    """Read a broken line through (centre, height) with these slopes at each value, in float64."""
    launch_each(_curve, out.shape[0], 8 * out.size, [image, centres, heights, slopes], [out])


@wp.kernel
def _survey(
    slab: int,
    first: int,
    last: int,
    stride: int,
    image: wp.array[float],
    # outputs
    keys: wp.array2d[wp.int64],
):
    least = float(wp.inf)
    most = float(-wp.inf)
    others = wp.int64(0)
    for i in range(first + wp.tid(), last, stride):
        value = image[i]
        if wp.isfinite(value):
            least = wp.min(least, value)
            most = wp.max(most, value)
        else:
            others = wp.int64(1)
    slot = (slab + wp.tid()) % _SLOTS
    if least <= most:
        wp.atomic_max(keys, slot, 0, wp.int64(4294967296) - key_of(least))
        wp.atomic_max(keys, slot, 1, key_of(most))
    wp.atomic_max(keys, slot, 2, others)


@wp.kernel
def _tone_maps(
    stride: int,
    first: int,
    last: int,
    limit: int,
    scale: wp.float64,
    # outputs
    counts: wp.array2d[int],
    maps: wp.array2d[int],
):
    length = counts.shape[1]
    for t in range(first + wp.tid(), last, stride):
        left = int(0)
        for b in range(length):
            left += wp.max(counts[t, b] - limit, 0)
        share = left // length
        free = int(0)
        for b in range(length):
            value = wp.min(counts[t, b], limit)
            if value < limit - share:
                value += share
                left -= share
            if value < limit and value >= limit - share:
                left -= limit - value
                value = limit
            if value < limit:
                free += 1
            counts[t, b] = value
        start = int(0)
        while left > 0 and free > 0:
            step = wp.max(free // left, 1)
            for b in range(start, length, step):
                if counts[t, b] < limit:
                    counts[t, b] += 1
                    left -= 1
                    if counts[t, b] == limit:
                        free -= 1
            start = (start + 1) % length
        total = int(0)
        for b in range(length):
            total += counts[t, b]
            maps[t, b] = wp.min(int(wp.float64(total) * scale), _TONES - 1)


@wp.func
def _place(steps: wp.array[wp.float64], value: wp.float64, count: int):
    low = int(0)
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if value >= steps[middle]:
            low = middle
        else:
            high = middle
    return low


@wp.kernel
def _count(
    slab: int,
    first: int,
    last: int,
    stride: int,
    image: wp.array[float],
    edges: wp.array[wp.float64],
    # outputs
    counts: wp.array2d[int],
):
    for i in range(first + wp.tid(), last, stride):
        low = _place(edges, wp.float64(image[i]), counts.shape[1])
        wp.atomic_add(counts, slab, low, 1)


@wp.kernel
def _curve(
    stride: int,
    first: int,
    last: int,
    image: wp.array[float],
    centres: wp.array[wp.float64],
    heights: wp.array[wp.float64],
    slopes: wp.array[wp.float64],
    # outputs
    out: wp.array[float],
):
    count = centres.shape[0]
    for i in range(first + wp.tid(), last, stride):
        value = wp.clamp(wp.float64(image[i]), centres[0], centres[count - 1])
        low = _place(centres, value, count - 1)
        out[i] = wp.float32(heights[low] + slopes[low] * (value - centres[low]))
