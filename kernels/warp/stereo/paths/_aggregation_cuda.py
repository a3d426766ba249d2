"""Semi-global aggregation on CUDA: all paths in one launch, then their sums in another.

The first leaves a volume per path (see _steps_cuda.py), the second adds them to the costs. The
matcher does the second in shared memory, and picks the winners of both images there at once.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch, scratch

from ._steps_cuda import (
    BLOCK,
    C_TYPES,
    CHUNK,
    FAR_COSTS,
    OPTIONS,
    PATHS,
    WALK_BLOCK,
    Steps,
    lanes,
    text_of,
    walk,
    walk_threads,
)

wp.set_module_options(OPTIONS)

# One chunk of 16 disparities a thread, from rows of any length to rows of whole chunks.
_PAD = """
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int depth = costs.shape[2], chunks = padded.shape[2] / 16, d = i % chunks * 16;
    const long long pixel = i / chunks;
    if (pixel >= (long long)padded.shape[0] * padded.shape[1]) return;
    const COST_TYPE* from = costs.data + pixel * depth;
    COST_TYPE value[16];
    #pragma unroll
    for (int j = 0; j < 16; ++j) value[j] = d + j < depth ? from[d + j] : (COST_TYPE)FAR;
    uint4* to = reinterpret_cast<uint4*>(padded.data + pixel * padded.shape[2] + d);
    #pragma unroll
    for (int j = 0; j < COST_BYTES; ++j) {
        unsigned word[4];
        #pragma unroll
        for (int k = 0; k < 4; ++k)
            word[k] = COST_BYTES == 1
                ? value[4 * k] | value[4 * k + 1] << 8 | value[4 * k + 2] << 16
                    | (unsigned)value[4 * k + 3] << 24
                : value[(8 * j + 2 * k) % 16] | (unsigned)value[(8 * j + 2 * k + 1) % 16] << 16;
        to[j] = make_uint4(word[0], word[1], word[2], word[3]);
    }
"""


@lru_cache
def pad(cost_type: Any) -> wp.Kernel:
    """Return the kernel that pads costs, with such as never win and change no neighbour's."""
    text = text_of(
        _PAD,
        COST_BYTES=wp.types.type_size_in_bytes(cost_type),
        COST_TYPE=C_TYPES[cost_type],
        FAR=FAR_COSTS[cost_type],
        BLOCK=BLOCK,
    )

    @wp.func_native(text)
    def pad_chunk(costs: wp.array3d[cost_type], padded: wp.array3d[cost_type]): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def pad(
        costs: wp.array3d[cost_type],  # (H, W, D)
        # outputs
        padded: wp.array3d[cost_type],  # (H, W, D rounded up)
    ):
        pad_chunk(costs, padded)

    return pad


# Sums over the paths of 16 disparities, from `at` in each volume, two in a number. A pair of 16
# bits never carries into the next: sums are below 65536.
TOTAL = """
    unsigned total[8], even[4], odd[4];  // pairs (0, 1), ...; (0, 2), ...; (1, 3), ...
    uint4 chunk[COUNT][PATH_BYTES];
    #pragma unroll
    for (int r = 0; r < COUNT; ++r) {
        #pragma unroll
        for (int j = 0; j < PATH_BYTES; ++j)
            chunk[r][j] = __ldcs(reinterpret_cast<const uint4*>(
                lines.data + r * (pixels * padded) + at) + j);
    }
    #pragma unroll
    for (int k = 0; k < 8; ++k) total[k] = even[k / 2] = odd[k / 2] = 0;
    #pragma unroll
    for (int r = 0; r < COUNT; ++r) {
        #pragma unroll
        for (int j = 0; j < PATH_BYTES; ++j) {
            const unsigned word[4] = {chunk[r][j].x, chunk[r][j].y, chunk[r][j].z, chunk[r][j].w};
            #pragma unroll
            for (int k = 0; k < 4; ++k) {
                if (PATH_BYTES == 1) {
                    even[k] += word[k] & 0xff00ffu;
                    odd[k] += word[k] >> 8 & 0xff00ffu;
                } else {
                    total[4 * j + k] += word[k];
                }
            }
        }
    }
    #pragma unroll
    for (int k = 0; k < 4; ++k) {
        total[2 * k] += __byte_perm(even[k], odd[k], 0x5410);
        total[2 * k + 1] += __byte_perm(even[k], odd[k], 0x7632);
    }
"""

_COLLECT = (
    """
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int padded = costs.shape[2], depth = sums.shape[2], d = i % (padded / 16) * 16;
    const long long pixel = i / (padded / 16), pixels = (long long)sums.shape[0] * sums.shape[1];
    if (pixel >= pixels) return;
    const long long at = pixel * padded + d, from = at + (long long)top * costs.shape[1] * padded;
"""
    + TOTAL
    + """
    // Each path has left L - C.
    #pragma unroll
    for (int j = 0; j < COST_BYTES; ++j) {
        const uint4 c = reinterpret_cast<const uint4*>(costs.data + from)[j];
        const unsigned word[4] = {c.x, c.y, c.z, c.w};
        #pragma unroll
        for (int k = 0; k < 4; ++k) {
            if (COST_BYTES == 1) {
                total[2 * k] += __byte_perm(word[k], 0, 0x4140) * COUNT;
                total[2 * k + 1] += __byte_perm(word[k], 0, 0x4342) * COUNT;
            } else {
                total[4 * j + k] += word[k] * COUNT;
            }
        }
    }
    unsigned short* to = sums.data + pixel * depth + d;
    if (aligned) {
        uint4* eight = reinterpret_cast<uint4*>(to);
        #pragma unroll
        for (int j = 0; j < 2; ++j) {
            uint4 s = make_uint4(0, 0, 0, 0);
            if (d + 8 * j < depth) {
                if (adds) s = eight[j];
                eight[j] = make_uint4(s.x + total[4 * j], s.y + total[4 * j + 1],
                                      s.z + total[4 * j + 2], s.w + total[4 * j + 3]);
            }
        }
    } else {
        #pragma unroll
        for (int j = 0; j < 16; ++j)
            if (d + j < depth)
                to[j] = (adds ? to[j] : 0) + (unsigned short)(total[j / 2] >> 16 * (j % 2));
    }
"""
)


@lru_cache
def collect(cost_type: Any, line_type: Any, count: int) -> wp.Kernel:
    """Return the kernel that sums what `count` paths have left."""
    text = text_of(
        _COLLECT,
        COST_BYTES=wp.types.type_size_in_bytes(cost_type),
        PATH_BYTES=wp.types.type_size_in_bytes(line_type),
        COUNT=count,
        BLOCK=BLOCK,
    )

    @wp.func_native(text)
    def collect_chunk(
        costs: wp.array3d[cost_type],
        lines: wp.array4d[line_type],
        top: int,
        adds: bool,
        aligned: bool,
        sums: wp.array3d[wp.uint16],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def collect(
        costs: wp.array3d[cost_type],  # (H, W, D rounded up)
        lines: wp.array4d[line_type],  # (count, h, W, D rounded up)
        top: int,
        adds: bool,  # whether sums holds those of other paths
        aligned: bool,  # whether rows of sums fall into aligned groups of 8
        # outputs
        sums: wp.array3d[wp.uint16],  # (h, W, D), rows of the image from `top` on
    ):
        collect_chunk(costs, lines, top, adds, aligned, sums)

    return collect


def aggregate(
    costs: wp.array,
    guide: wp.array,
    p1: int,
    p2: wp.array,
    p2_max: int,
    paths: int,
    top: int,
    sums: wp.array,
) -> None:
    """Sum the costs of the cheapest paths to each pixel, up to eight paths at a time."""
    rows, width, depth = sums.shape
    costs = in_chunks(costs)
    aligned = depth % 8 == 0 and sums.ptr % 16 == 0
    line_type = wp.uint8 if p2_max < 256 else wp.uint16
    for n, steps in enumerate(PATHS[paths]):
        shape = (len(steps), rows, width, costs.shape[2])
        lines = scratch("semi_global.lines", shape, line_type, sums.device)
        walk_paths(costs, guide, p1, p2, steps, False, top, lines)
        launch(
            collect(costs.dtype, line_type, len(steps)),
            _chunk_threads(rows, width, costs.shape[2]),
            [costs, lines, top, n > 0, aligned],
            [sums],
        )


def in_chunks(costs: wp.array) -> wp.array:
    """Return `costs`, or a copy that is padded to whole chunks where they are not."""
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
    p1: int,
    p2: wp.array,
    steps: Steps,
    whole: bool,
    top: int,
    lines: wp.array,
) -> None:
    """Walk the paths that go by `steps`: L of the rows from `top` on if `whole`, else L - C."""
    height, width, depth = costs.shape
    group, chunks = lanes(depth)
    full = depth == group * chunks * CHUNK
    adaptive = guide.shape == (height, width)
    launch(
        walk(costs.dtype, lines.dtype, group, chunks, steps, full, adaptive, whole),
        walk_threads(height, width, depth, steps),
        [costs, guide, p1, p2, top],
        [lines],
        WALK_BLOCK,
    )


def _chunk_threads(height: int, width: int, depth: int) -> int:
    """Return how many threads take a chunk of a volume each: whole blocks."""
    return -(-height * width * depth // CHUNK // BLOCK) * BLOCK
