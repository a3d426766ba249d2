"""The paths of semi-global matching on CUDA: one group of threads per path.

aggregation.py has the equation. A thread has 16 disparities. One launch walks all paths, the
longest first. A path that leaves the image at one side enters it again at the other side, as a new
path. So every column begins one path of each direction, and all paths have the same length. Paths
that go up or down together read the same costs while these are in a cache.

A thread keeps the costs of its disparities in pairs of 16 bits, which Hopper's instructions for
dynamic programming process together. The result of path r is L_r, or L_r - C. The recursion bounds
L_r - C by P2, so mostly one byte is enough. Disparities are padded to a multiple of 16.
"""

from functools import lru_cache
from itertools import groupby
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

# With "default_grid_stride" off, Warp would number the blocks of large launches along three axes.
OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

BLOCK = 256  # threads of a block
WALK_BLOCK = 64  # threads of a block of paths; few, so that the longest paths spread
CHUNK = 16  # disparities that are loaded together, 16 or 32 bytes

# Steps (dy, dx) of paths. Paths along rows are the longest, so they come first. 16 paths are
# computed 8 at a time.
PATHS = {
    4: (((0, 1), (0, -1), (1, 0), (-1, 0)),),
    8: (((0, 1), (0, -1), (1, 0), (1, 1), (1, -1), (-1, 0), (-1, 1), (-1, -1)),),
}
_KNIGHTS = ((1, 2), (1, -2), (-1, 2), (-1, -2), (2, 1), (2, -1), (-2, 1), (-2, -1))
PATHS[16] = (*PATHS[8], _KNIGHTS)

FAR_COSTS = {wp.uint8: 255, wp.uint16: 1 << 14}  # none is larger: 4 paths sum to less than 2^16


def lanes(depth: int) -> tuple[int, int]:
    """Return the number of threads for `depth` disparities, and of chunks of 16 per thread."""
    chunks = -(-depth // CHUNK)
    group = 4
    while group < 32 and group < chunks:
        group *= 2
    each = 1
    while group * each < chunks:
        each *= 2
    return group, each


Steps = tuple[tuple[int, int], ...]


@lru_cache
def walk(
    cost_type: Any,
    line_type: Any,
    group: int,
    chunks: int,
    steps: Steps,
    full: bool,
    adaptive: bool,
    whole: bool,
) -> wp.Kernel:
    """Return the kernel that walks `steps`, with `group` threads of 16 `chunks` disparities.

    `full` means that the disparities fill all threads.
    """
    cost_bytes = wp.types.type_size_in_bytes(cost_type)
    ahead = 8 if group <= 8 else 4  # with few threads per path, few others hide the latency
    sets = [len(list(paths)) for _, paths in groupby(steps, key=lambda step: step[0])]
    bounds = [f"{{{sum(sets[:i])}, {n}}}" for i, n in enumerate(sets)]
    constants = {
        "STEPS": f"{{{', '.join(f'{{{dy}, {dx}}}' for dy, dx in steps)}}}",
        "BOUNDS": f"{{{', '.join(bounds)}}}",
        "SETS": len(sets),
        "COUNT": len(steps),
        "COST_BYTES": cost_bytes,
        "PATH_BYTES": wp.types.type_size_in_bytes(line_type),
        "COST_TYPE": cost_type,
        "PATH_TYPE": line_type,
        "FAR": f"{FAR_COSTS[cost_type] * (0x1010101 if cost_bytes == 1 else 0x10001):#x}u",
        "AHEAD": max(2, ahead // (chunks * cost_bytes)),
        "CHUNKS": chunks,
        "GROUP": group,
        "BLOCK": WALK_BLOCK,
        "FULL": int(full),
        "ADAPTIVE": int(adaptive),
        "WHOLE": int(whole),
    }

    @_native.kernel("_steps_cuda.cu", OPTIONS, **constants)
    def walk(
        costs: wp.array3d[cost_type],  # (H, W, D)
        guide: wp.array2d[wp.uint8],  # (H, W)
        p1: int,
        p2: wp.array[wp.uint16],  # (256,)
        top: int,
        # outputs
        lines: wp.array4d[line_type],  # (paths, h, W, D), rows of the image from `top` on
    ): ...

    return walk


def walk_threads(height: int, width: int, depth: int, steps: Steps) -> int:
    """Return the number of threads: whole blocks for each direction."""
    groups = WALK_BLOCK // lanes(depth)[0]
    counts = [min(abs(dy), height) * width if dy != 0 else height for dy, _ in steps]
    return sum(-(-count // groups) for count in counts) * WALK_BLOCK
