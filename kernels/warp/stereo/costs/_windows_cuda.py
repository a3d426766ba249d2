"""Matching costs summed over windows on CUDA: down the columns, then along the rows.

The work is done in strips of rows, so that the sums between the two passes stay in the cache. A
thread walks down some rows, or along some columns, of one disparity; neighbouring threads have the
disparities of a pixel. Integers have running sums; floats are summed again for each pixel, in the
order of _sums_cpu.h. The code is native for loads through the read-only cache, which do not wait
for stores.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, scratch

from ._moments import Moments
from ._windows_cpu import OPTIONS, Windows, windows_of

_BLOCK = 256
_DOWN, _ALONG = 16, 64  # sums that one thread computes
_STRIP_BYTES = 24 << 20  # half the second-level cache of the largest GPUs


def _constants(kept: Any) -> dict[str, Any]:
    """Return the constants for sums that are stored in one type."""
    floats = kept in (wp.float32, wp.float64)
    return {
        "KEPT": kept,
        "SUM": kept if floats else wp.int32,
        "FLOATS": "true" if floats else "false",
        "UNROLL": 1 if floats else 8,
        "BLOCK": _BLOCK,
    }


@lru_cache
def sum_down(cost: int, pixel: Any, kept: Any) -> wp.Kernel:
    """Return the kernel of a cost; it is compiled at the first use."""
    value = wp.int32 if pixel is wp.uint8 else pixel
    needs = {
        **_constants(kept),
        **{code.name: int(code) for code in Cost if code != Cost.CENSUS_SYMMETRIC},
        "COST": int(cost),
        "PIXEL": pixel,
        "VALUE": value,
        "DOWN": _DOWN,
    }

    @_native.kernel("_down_cuda.cu", OPTIONS, **needs)
    def sum_down(
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        windows: Windows,
        top: int,
        # outputs
        sums: wp.array3d[kept],  # (rows of the strip, W + 2 radius_x, D)
    ): ...

    return sum_down


@lru_cache
def sum_along(kept: Any, out: Any) -> wp.Kernel:
    """Return the kernel for sums and costs of these types."""
    needs = {**_constants(kept), "ALONG": _ALONG, "OUT": out}

    @_native.kernel("_windows_cuda.cu", OPTIONS, **needs)
    def sum_along(
        sums: wp.array3d[kept],  # (rows of the strip, W + 2 radius_x, D)
        radius_x: int,
        top: int,
        # outputs
        costs: wp.array3d[out],  # (H, W, D)
    ): ...

    return sum_along


@lru_cache
def correlate_along(kept: Any) -> wp.Kernel:
    """Return the kernel for sums of products of this type."""

    @_native.kernel("_windows_cuda.cu", OPTIONS, ALONG=_ALONG, **_constants(kept))
    def correlate_along(
        sums: wp.array3d[kept],  # (rows of the strip, W + 2 radius_x, D)
        of_left: Moments,
        of_right: Moments,
        windows: Windows,
        top: int,
        # outputs
        costs: wp.array3d[float],  # (H, W, D)
    ): ...

    return correlate_along


def window_costs(
    left: wp.array,
    right: wp.array,
    first: int,
    cost: int,
    radius_y: int,
    radius_x: int,
    costs: wp.array,
    *,
    begin: int = 0,
) -> None:
    """Fill the costs, strip by strip."""
    kept = _kept(cost, left.dtype, costs.dtype)
    windows = windows_of(first, 1, radius_y, radius_x)
    for top, sums in _strips(costs, radius_x, kept):
        inputs = [left, right, windows, begin + top]
        _launch_down(sum_down(cost, left.dtype, kept), inputs, sums)
        _launch_along(sum_along(kept, costs.dtype), [sums, radius_x, top], sums, costs)


def correlation(
    left: wp.array, right: wp.array, windows: Windows, of_both: list[Moments], costs: wp.array
) -> None:
    """Sum the products, and fill the costs."""
    kept = _kept(Cost.ZNCC, left.dtype, costs.dtype)
    for top, products in _strips(costs, windows.radius_x, kept):
        inputs = [left, right, windows, top]
        _launch_down(sum_down(Cost.ZNCC, left.dtype, kept), inputs, products)
        inputs = [products, *of_both, windows, top]
        _launch_along(correlate_along(kept), inputs, products, costs)


def _kept(cost: int, pixel: Any, out: Any) -> Any:
    """Return the type in which sums of columns are stored."""
    if pixel is wp.float32:
        return wp.float64 if cost == Cost.ZNCC else wp.float32
    return wp.int32 if out is wp.float32 else wp.uint16


def _strips(costs: wp.array, radius_x: int, kept: Any) -> Iterator[tuple[int, wp.array]]:
    """Yield the first row of each strip, and scratch memory for its sums down the columns."""
    height, width, depth = costs.shape
    row = (width + 2 * radius_x) * depth * wp.types.type_size_in_bytes(kept)
    rows = min(height, max(_DOWN, _STRIP_BYTES // row // _DOWN * _DOWN))
    for top in range(0, height, rows):
        shape = (min(rows, height - top), width + 2 * radius_x, depth)
        yield top, scratch("window.sums", shape, kept, costs.device)


def _launch_down(kernel: wp.Kernel, inputs: list[Any], sums: wp.array) -> None:
    rows, wide, depth = sums.shape
    launch(kernel, _threads(wide * depth) * -(-rows // _DOWN), inputs, [sums])


def _launch_along(kernel: wp.Kernel, inputs: list[Any], sums: wp.array, costs: wp.array) -> None:
    runs = -(-costs.shape[1] // _ALONG)
    launch(kernel, _threads(runs * costs.shape[2]) * sums.shape[0], inputs, [costs])


def _threads(count: int) -> int:
    """Return `count` threads, rounded up to whole blocks."""
    return -(-count // _BLOCK) * _BLOCK
