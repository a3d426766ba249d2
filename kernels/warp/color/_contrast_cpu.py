"""Histograms and tone curves on the CPU, in native code: slabs of pixels, tiles or rows."""

from typing import Any

import warp as wp

from cvkern.kernels.codes.color import LEVELS, TONES
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FILE = "_contrast_cpu.h"
_PART = 128  # pixels that are blended at once


def _find_levels(scalar: Any, level: Any) -> wp.Kernel:
    """Return the kernel for images of one type, whose levels have another."""
    types = {"TYPE": scalar, "LEVEL": level}

    @_native.kernel(_FILE, REAL=int(scalar is wp.float32), MOST=f"{LEVELS - 1}.0f", **types)
    def find_levels(
        slab: int,
        first: int,
        last: int,
        image: wp.array2d[scalar],
        scale: float,
        # outputs
        found: wp.array[level],
    ): ...

    return find_levels


def _scale_colours(scalar: Any, to: Any) -> wp.Kernel:
    """Return the kernel for images of one type, and results of another."""
    whole = int(to is wp.uint8)

    @_native.kernel(_FILE, TYPE=scalar, OUT=to, WHOLE=whole)
    def scale_colours(
        slab: int,
        first: int,
        last: int,
        image: wp.array2d[scalar],
        found: wp.array[wp.uint16],
        table: wp.array[float],
        # outputs
        out: wp.array2d[to],
    ): ...

    return scale_colours


def _read_table(level: Any, bits: Any) -> wp.Kernel:
    """Return the kernel for levels of one type, and results with the bits of another."""

    @_native.kernel(_FILE, LEVEL=level, BITS=bits)
    def read_table(
        slab: int,
        first: int,
        last: int,
        found: wp.array[level],
        table: wp.array[bits],
        # outputs
        out: wp.array[bits],
    ): ...

    return read_table


def _of_levels(level: Any) -> tuple[wp.Kernel, ...]:
    """Return the kernels for levels of one type."""
    in_bytes = int(level is wp.uint8)

    @_native.kernel(_FILE, LEVEL=level)
    def count_levels(
        slab: int,
        first: int,
        last: int,
        found: wp.array[level],
        # outputs
        parts: wp.array3d[int],
    ): ...

    @_native.kernel(_FILE, LEVEL=level)
    def find_extent(
        slab: int,
        first: int,
        last: int,
        found: wp.array[level],
        # outputs
        parts: wp.array2d[int],
    ): ...

    @_native.kernel(_FILE, LEVEL=level, BYTES=in_bytes)
    def count_tiles(
        slab: int,
        first: int,
        last: int,
        found: wp.array2d[level],
        bins: wp.array[int],
        rows: wp.array[int],
        columns: wp.array[int],
        parts: wp.array3d[int],
        # outputs
        counts: wp.array3d[int],
    ): ...

    @_native.kernel(_FILE, LEVEL=level, BYTES=in_bytes, TONES=TONES, PART=_PART)
    def blend_rows(
        slab: int,
        first: int,
        last: int,
        found: wp.array2d[level],
        bins: wp.array[int],
        maps: wp.array3d[int],
        shares: wp.array[wp.float64],
        height: int,
        quads: wp.array2d[int],
        weights: wp.array2d[wp.float64],
        # outputs
        mixed: wp.array2d[wp.uint16],
    ): ...

    return count_levels, find_extent, count_tiles, blend_rows


_REAL, _BYTE, _WORD = wp.float32, wp.uint8, wp.uint16
_LEVELS = {level: _of_levels(level) for level in (_BYTE, _WORD)}
count_levels, find_extent, count_tiles, blend_rows = (
    {t: four[i] for t, four in _LEVELS.items()} for i in range(4)
)
find_levels = {t: _find_levels(t, _BYTE if t is _BYTE else _WORD) for t in (_BYTE, _WORD, _REAL)}
# Floats pass as integers with their bits.
read_table = {(t, b): _read_table(t, b) for t in (_BYTE, _WORD) for b in (_BYTE, wp.int32)}
scale_colours = {
    (t, to): _scale_colours(t, to) for t in (_BYTE, _WORD, _REAL) for to in (_BYTE, _REAL)
}
