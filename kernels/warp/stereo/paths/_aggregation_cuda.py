"""Semi-global aggregation on CUDA: all paths in one launch, then their sums in another.

aggregation.py has the equation. The first launch stores a volume per path (see _steps_cuda.py), the
second adds these to the costs. The matcher sums in shared memory instead, and picks the winners of
both images there.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Penalties
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, scratch

from ._steps_cuda import (
    BLOCK,
    CHUNK,
    FAR_COSTS,
    OPTIONS,
    PATHS,
    WALK_BLOCK,
    Steps,
    lanes,
    walk,
    walk_threads,
)

wp.set_module_options(OPTIONS)


@lru_cache
def pad(cost_type: Any) -> wp.Kernel:
    """Return the kernel that pads costs with values that never win and affect no neighbour."""
    size = wp.types.type_size_in_bytes(cost_type)
    constants = {"COST_TYPE": cost_type, "COST_BYTES": size, "FAR": FAR_COSTS[cost_type]}

    @_native.kernel("_costs_cuda.cu", OPTIONS, BLOCK=BLOCK, **constants)
    def pad(
        costs: wp.array3d[cost_type],  # (H, W, D)
        # outputs
        padded: wp.array3d[cost_type],  # (H, W, D rounded up)
    ): ...

    return pad


@lru_cache
def collect(cost_type: Any, line_type: Any, count: int) -> wp.Kernel:
    """Return the kernel that sums the volumes of `count` paths."""
    constants = {
        "COST_TYPE": cost_type,
        "COST_BYTES": wp.types.type_size_in_bytes(cost_type),
        **total_constants(line_type, count),
    }

    @_native.kernel("_aggregation_cuda.cu", OPTIONS, BLOCK=BLOCK, **constants)
    def collect(
        costs: wp.array3d[cost_type],  # (H, W, D rounded up)
        lines: wp.array4d[line_type],  # (count, h, W, D rounded up)
        top: int,
        adds: bool,  # whether `sums` already holds those of other paths
        aligned: bool,  # whether rows of sums consist of aligned groups of 8
        # outputs
        sums: wp.array3d[wp.uint16],  # (h, W, D), rows of the image from `top` on
    ): ...

    return collect


def total_constants(line_type: Any, count: int) -> dict[str, Any]:
    """Return the constants of _total_cuda.h."""
    size = wp.types.type_size_in_bytes(line_type)
    return {"PATH_TYPE": line_type, "PATH_BYTES": size, "COUNT": count}


def aggregate(
    costs: wp.array,
    guide: wp.array,
    penalties: Penalties,
    paths: int,
    top: int,
    sums: wp.array,
) -> None:
    """Sum the costs of the cheapest paths to each pixel, up to eight paths at a time."""
    rows, width, depth = sums.shape
    costs = in_chunks(costs)
    aligned = depth % 8 == 0 and sums.ptr % 16 == 0
    line_type = wp.uint8 if penalties.most < 256 else wp.uint16
    for n, steps in enumerate(PATHS[paths]):
        shape = (len(steps), rows, width, costs.shape[2])
        lines = scratch("semi_global.lines", shape, line_type, sums.device)
        walk_paths(costs, guide, penalties, steps, False, top, lines)
        launch(
            collect(costs.dtype, line_type, len(steps)),
            _chunk_threads(rows, width, costs.shape[2]),
            [costs, lines, top, n > 0, aligned],
            [sums],
        )


def in_chunks(costs: wp.array) -> wp.array:
    """Return `costs`, or a copy padded to whole chunks if necessary."""
    height, width, depth = costs.shape
    padded = -(-depth // CHUNK) * CHUNK
    if padded == depth and costs.ptr % CHUNK == 0:
        return costs
    copy = scratch("semi_global.costs", (height, width, padded), costs.dtype, costs.device)
    launch(pad(costs.dtype), _chunk_threads(height, width, padded), [costs], [copy])
    return copy


def walk_paths(
    costs: wp.array,
    guide: wp.array,
    penalties: Penalties,
    steps: Steps,
    whole: bool,
    top: int,
    lines: wp.array,
) -> None:
    """Walk the paths with these `steps`; store L of the rows after `top` if `whole`, else L - C."""
    height, width, depth = costs.shape
    group, chunks = lanes(depth)
    full = depth == group * chunks * CHUNK
    adaptive = guide.shape == (height, width)
    launch(
        walk(costs.dtype, lines.dtype, group, chunks, steps, full, adaptive, whole),
        walk_threads(height, width, depth, steps),
        [costs, guide, penalties.near, penalties.far, top],
        [lines],
        WALK_BLOCK,
    )


def _chunk_threads(height: int, width: int, depth: int) -> int:
    """Return the number of threads, in whole blocks, with one chunk of a volume per thread."""
    return -(-height * width * depth // CHUNK // BLOCK) * BLOCK
