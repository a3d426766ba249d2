"""Matching costs summed over windows on the CPU, one thread per slab of rows.

_sums_cpu.h has the costs and the order of the sums. The code is native, because a vector holds 16
to 64 disparities of a pixel: bytes are compared as bytes, and only their sums are wider.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import scratch
from cvkern.kernels.warp._structs import struct_of

# Without fused multiply-add a cost has the same bits on every device.
OPTIONS = {"enable_backward": False, "fuse_fp": False}

# Number of disparities in a vector, by the type of the sums.
LANES_OF = {wp.uint16: 64, wp.int32: 32, wp.float32: 32, wp.float64: 16}


@wp.struct
class Windows:
    """The windows and disparities of the sums."""

    first: int  # disparity of the first costs
    octets: int  # used octets of a word of bits; 1 for numbers
    radius_y: int
    radius_x: int


def windows_of(first: int, octets: int, radius_y: int, radius_x: int) -> Windows:
    """Return the struct of some windows."""
    return struct_of(Windows, (first, octets, radius_y, radius_x))


def sums_dtype(pixel: Any, out: Any) -> Any:
    """Return the type of the sums for costs of type `out`."""
    if pixel is wp.float32:
        return wp.float32
    return wp.int32 if out is wp.float32 else wp.uint16


def values_dtype(pixel: Any) -> Any:
    """Return the type of the values that are compared; words are compared by octets."""
    return wp.float32 if pixel is wp.float32 else wp.uint8


def padded(count: int, sums: Any) -> int:
    """Return `count` disparities, rounded up to whole vectors."""
    return -(-count // LANES_OF[sums]) * LANES_OF[sums]


def slab_scratch(
    left: wp.array, slabs: int, count: int, cost: int, windows: Windows, sums: Any
) -> tuple[wp.array, wp.array]:
    """Return the lines of two rows, and the sums down the columns, of each slab."""
    reach = padded(count, sums)
    wide = left.shape[1] + 2 * windows.radius_x
    planes = left.shape[2] * windows.octets * (3 if cost == Cost.BIRCHFIELD_TOMASI else 1)
    lines = (slabs, 2 * planes * (2 * wide + reach + 4))
    return (
        scratch("window.lines", lines, values_dtype(left.dtype), left.device),
        scratch("window.columns", (slabs, wide * reach), sums, left.device),
    )


def constants(cost: int, pixel: Any, sums: Any) -> dict[str, Any]:
    """Return the constants of _sums_cpu.h."""
    return {
        "COST": int(cost),
        **{code.name: int(code) for code in Cost if code != Cost.CENSUS_SYMMETRIC},
        "PIXEL": values_dtype(pixel),
        "ELEMENT": pixel,
        "SUM": sums,
        "LANES": LANES_OF[sums],
        "FLOATS": "true" if pixel is wp.float32 else "false",
    }


@lru_cache
def window_costs(cost: int, pixel: Any, out: Any) -> wp.Kernel:
    """Return the kernel of a cost, for images and costs of these types."""
    value, sums = values_dtype(pixel), sums_dtype(pixel, out)
    needs = {**constants(cost, pixel, sums), "OUT": out}

    @_native.kernel("_windows_cpu.h", OPTIONS, **needs)
    def window_costs(
        slab: int,
        first: int,
        last: int,
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        windows: Windows,
        # scratch
        lines: wp.array2d[value],  # (slabs, 2 rows)
        columns: wp.array2d[sums],  # (slabs, (W + 2 radius_x) padded(D))
        # outputs
        costs: wp.array3d[out],  # (H, W, D)
    ): ...

    return window_costs
