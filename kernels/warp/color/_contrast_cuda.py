"""Histograms and tone curves on CUDA, one thread a pixel; counts by blocks, in native code."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.color import LEVELS, TONES
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK, launch

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OPTIONS = {"enable_backward": False, "fuse_fp": False}
BINS = 1024  # bins of a histogram in shared memory, at most
GROUP = 16  # pixels of a thread at once
MOST = 2**17  # threads that count, which take pixels in turns

_MOST = wp.constant(float(LEVELS - 1))
_TONES = wp.constant(TONES)


@wp.func
def _share(value: int, weight: wp.float64):
    return wp.float32(wp.float64(value) * weight)


def _find_levels(scalar: Any, level: Any) -> wp.Kernel:
    """Return the kernel for images of one type, whose levels have another."""

    @wp.kernel
    def find_levels(
        image: wp.array2d[scalar],
        scale: float,
        # outputs
        found: wp.array[level],
    ):
        i = wp.tid()
        most = image[i, 0]
        for c in range(1, image.shape[1]):
            most = wp.max(most, image[i, c])
        # The nearest, and of two the even one, as NumPy rounds.
        found[i] = level(int(wp.rint(wp.clamp(float(most) * scale, 0.0, _MOST))))

    return find_levels


def _scale_colours(scalar: Any, to: Any) -> wp.Kernel:
    """Return the kernel for images of one type, and results of another."""
    whole = to is wp.uint8

    @wp.kernel
    def scale_colours(
        image: wp.array2d[scalar],
        found: wp.array[wp.uint16],
        table: wp.array[float],
        # outputs
        out: wp.array2d[to],
    ):
        i = wp.tid()
        new = table[int(found[i])]
        most = float(image[i, 0])
        for c in range(1, 3):
            most = wp.max(most, float(image[i, c]))
        for c in range(3):
            value = new
            if most > 0.0:
                value = float(image[i, c]) * new / most
            if wp.static(whole):
                value = wp.rint(value)
            out[i, c] = to(value)

    return scale_colours


def _read_table(level: Any, bits: Any) -> wp.Kernel:
    """Return the kernel for levels of one type, and results with the bits of another."""

    @wp.kernel
    def read_table(
        found: wp.array[level],
        table: wp.array[bits],
        # outputs
        out: wp.array[bits],
    ):
        i = wp.tid()
        out[i] = table[int(found[i])]

    return read_table


def _of_levels(level: Any) -> tuple[wp.Kernel, ...]:
    """Return the kernels for levels of one type."""

    @wp.kernel
    def find_extent(
        stride: int,
        found: wp.array[level],
        # outputs
        ends: wp.array[int],
    ):
        least = int(found[0])
        most = least
        for i in range(wp.tid(), found.shape[0], stride):
            least = wp.min(least, int(found[i]))
            most = wp.max(most, int(found[i]))
        wp.atomic_min(ends, 0, least)
        wp.atomic_max(ends, 1, most)

    @wp.kernel
    def count_tiles(
        found: wp.array2d[level],
        bins: wp.array[int],
        rows: wp.array[int],
        columns: wp.array[int],
        # outputs
        counts: wp.array3d[int],
    ):
        y, x = wp.tid()
        code = bins[int(found[rows[y], columns[x]])]
        height = rows.shape[0] // counts.shape[0]
        width = columns.shape[0] // counts.shape[1]
        wp.atomic_add(counts, y // height, x // width, code, 1)

    @wp.kernel
    def blend_pixels(
        found: wp.array2d[level],
        bins: wp.array[int],
        maps: wp.array3d[int],
        shares: wp.array[wp.float64],
        height: int,
        # outputs
        mixed: wp.array2d[wp.uint16],
    ):
        y, x = wp.tid()
        one = wp.float64(1.0)
        width = shares.shape[0] - height
        py = y + height // 2
        px = x + width // 2
        top = wp.max(py // height - 1, 0)
        bottom = wp.min(py // height, maps.shape[0] - 1)
        left = wp.max(px // width - 1, 0)
        right = wp.min(px // width, maps.shape[1] - 1)
        v = shares[py % height]
        u = shares[height + px % width]
        code = bins[int(found[y, x])]
        total = _share(maps[top, left, code], (one - u) * (one - v))
        total += _share(maps[top, right, code], u * (one - v))
        total += _share(maps[bottom, left, code], (one - u) * v)
        total += _share(maps[bottom, right, code], u * v)
        mixed[y, x] = wp.uint16(wp.min(int(total), _TONES - 1))

    return find_extent, count_tiles, blend_pixels


_REAL, _BYTE, _WORD = wp.float32, wp.uint8, wp.uint16
_LEVELS = {level: _of_levels(level) for level in (_BYTE, _WORD)}
find_extent, count_tiles, blend_pixels = (
    {t: three[i] for t, three in _LEVELS.items()} for i in range(3)
)
find_levels = {t: _find_levels(t, _BYTE if t is _BYTE else _WORD) for t in (_BYTE, _WORD, _REAL)}
# Floats pass as integers with their bits.
read_table = {(t, b): _read_table(t, b) for t in (_BYTE, _WORD) for b in (_BYTE, wp.int32)}
scale_colours = {
    (t, to): _scale_colours(t, to) for t in (_BYTE, _WORD, _REAL) for to in (_BYTE, _REAL)
}


def count(found: wp.array, counts: wp.array) -> None:
    """Count how often each level occurs."""
    kernel = _count_levels(found.dtype)
    launch(kernel, _threads(found.shape[0]), [found], [counts])


def count_values(image: wp.array, edges: wp.array, counts: wp.array) -> None:
    """Count the values in at most BINS bins between edges."""
    launch(count_bins, _threads(image.shape[0]), [image, edges], [counts])


def _threads(count: int) -> int:
    """Return the threads of whole blocks for so many pixels."""
    return -(-min(-(-count // GROUP), MOST) // BLOCK) * BLOCK


@lru_cache
def _count_levels(level: Any) -> wp.Kernel:
    bins = 256 if level is _BYTE else 0

    @_native.kernel("_contrast_cuda.cu", OPTIONS, LEVEL=level, BINS=bins, GROUP=GROUP)
    def count_levels(
        found: wp.array[level],
        # outputs
        counts: wp.array[int],
    ):
        """Forward to the native code."""

    return count_levels


@_native.kernel("_contrast_cuda.cu", OPTIONS, BINS=BINS)
def count_bins(
    image: wp.array[float],
    edges: wp.array[wp.float64],
    # outputs
    counts: wp.array[int],
):
    """Forward to the native code."""
