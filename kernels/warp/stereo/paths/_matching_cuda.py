"""Winners of both images on CUDA, directly from the volumes of the paths.

A block takes a tile of a row. It sums the paths of its pixels in shared memory, and picks their
winners there. A diagonal of the tile belongs to one pixel of the right image. Its smallest (cost,
disparity) takes part in an atomic minimum over all tiles of the row.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import LARGEST_MATCH_COST, Penalties, Rule, View, Winners
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, scratch, view
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.stereo._winner import CURVES, WinnerArrays, WinnerRule
from cvkern.kernels.warp.stereo._winners_cuda import pick, pick_right

from ._aggregation_cuda import aggregate, total_constants, walk_paths
from ._costs_cuda import match_costs
from ._steps_cuda import BLOCK, CHUNK, OPTIONS, PATHS

wp.set_module_options(OPTIONS)

MOST_DISPARITIES = 2048  # most disparities for which 8 pixels fit into shared memory


def tile(depth: int) -> tuple[int, int]:
    """Return the numbers of disparities and of pixels that fit into shared memory."""
    room = 64
    while room < depth:
        room *= 2
    return room, min(64, max(8, 16384 // room))


@lru_cache
def winners(line_type: Any, paths: int, room: int, pixels: int) -> wp.Kernel:
    """Return the kernel for `paths` paths, at most `room` disparities and tiles of `pixels`."""
    constants = {
        "DEPTH": room,
        "TILE": pixels,
        "BLOCK": BLOCK,
        "NARROW": int(line_type is wp.uint8 and paths == 4),  # whether a sum has 10 bits
        "WIDE": wp.int32,
        **CURVES,
        **total_constants(line_type, paths),
    }

    @_native.kernel("_matching_cuda.cu", OPTIONS, **constants)
    def winners(
        lines: wp.array4d[line_type],  # (paths, h, W, D rounded up)
        depth: int,
        rule: WinnerRule,
        # outputs, all (h, W)
        found: WinnerArrays,
        right: wp.array2d[int],  # -1 before; keys after
    ): ...

    return winners


def match(
    left: View,
    right: View,
    count: int,
    penalties: Penalties,
    paths: int,
    rule: Rule,
    top: int,
    found: Winners,
    right_index: wp.array,
) -> None:
    """Match a pair; sums of more than eight paths, or of many disparities, are stored in memory."""
    height, width = left.gray.shape
    rows, device = right_index.shape[0], right_index.device
    padded = -(-count // CHUNK) * CHUNK
    costs = scratch("match.costs", (height, width, padded), wp.uint8, device)
    match_costs(left, right, rule.first, count, costs)
    if len(PATHS[paths]) > 1 or count > MOST_DISPARITIES:
        sums = scratch("match.sums", (rows, width, count), wp.uint16, device)
        aggregate(costs, left.gray, penalties, paths, top, sums)
        pick(sums, rule, found)
        pick_right(sums, rule.first, right_index)
        return
    line_type = wp.uint8 if LARGEST_MATCH_COST + penalties.most < 256 else wp.uint16
    lines = scratch("match.lines", (paths, rows, width, padded), line_type, device)
    walk_paths(costs, left.gray, penalties, PATHS[paths][0], True, top, lines)
    keys = view(right_index, wp.int32, (right_index.size,))
    launch(clear, right_index.size, [], [keys])
    room, pixels = tile(count)
    launch(
        winners(line_type, paths, room, pixels),
        rows * -(-width // pixels) * BLOCK,
        [lines, count, struct_of(WinnerRule, rule)],
        [struct_of(WinnerArrays, found), right_index],
    )
    launch(decode, right_index.size, [], [keys])


@wp.kernel
def clear(
    # outputs
    keys: wp.array[int],
):
    keys[wp.tid()] = -1


@wp.kernel
def decode(
    # outputs
    keys: wp.array[int],
):
    i = wp.tid()
    key = keys[i]
    if key != -1:
        keys[i] = key & 0xFFFF
