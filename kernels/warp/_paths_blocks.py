"""The paths of semi-global matching on CUDA: a group of threads walks one, 16 disparities a thread.

All paths are walked in one launch, the longest first. A thread keeps the costs of its disparities
in pairs of 16 bits, which Hopper's instructions for dynamic programming take at once. What it
leaves of path r is L_r, or L_r - C, which the recursion bounds by P2: mostly one byte. Disparities
are padded to a multiple of 16.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import warp as wp

OPTIONS = {"enable_backward": False, "fuse_fp": False, "default_grid_stride": False}
wp.set_module_options(OPTIONS)

BLOCK = 256  # threads of a block
CHUNK = 16  # disparities that are loaded together, 16 or 32 bytes

# The directions of the first 4, 8 and 16 paths, (dy, dx), the longest paths first.
STEPS = (
    *((0, 1), (0, -1), (1, 0), (-1, 0)),
    *((1, 1), (1, -1), (-1, 1), (-1, -1)),
    *((1, 2), (1, -2), (-1, 2), (-1, -2)),
    *((2, 1), (2, -1), (-2, 1), (-2, -1)),
)

# A path enters the image in the first |dy| rows or the first |dx| columns, seen in its direction.
_WALK = """
    const signed char steps[16][2] = STEPS;
    const unsigned ALL = 0xffffffffu;
    const int PAIRS = 8 * CHUNKS, LOADS = CHUNKS * COST_BYTES;
    const int lane = threadIdx.x % GROUP, width = costs.shape[1], height = costs.shape[0];
    const int depth = costs.shape[2];
    int block = blockIdx.x, path = first_path, dy, dx, rows, columns, count;
    for (;; ++path) {
        dy = steps[path][0];
        dx = steps[path][1];
        rows = min(abs(dy), height);
        columns = min(abs(dx), width);
        count = rows * width + columns * (height - rows);
        const int blocks = (count + BLOCK / GROUP - 1) / (BLOCK / GROUP);
        if (block < blocks) break;
        block -= blocks;
    }
    const int number = block * (BLOCK / GROUP) + threadIdx.x / GROUP;
    int y = 0, x = 0, length = 0;
    if (number < count) {
        if (number < rows * width) {
            y = number / width;
            x = number % width;
        } else {
            y = rows + (number - rows * width) / columns;
            x = (number - rows * width) % columns;
        }
        // As if dy and dx were positive, until here.
        length = max(height, width);
        if (dy != 0) length = min(length, (height - 1 - y) / abs(dy) + 1);
        if (dx != 0) length = min(length, (width - 1 - x) / abs(dx) + 1);
        if (dy < 0) y = height - 1 - y;
        if (dx < 0) x = width - 1 - x;
    }
    int most = length;  // the groups of a warp stay together, for the shuffles
    for (int o = 16; o > 0; o >>= 1) most = max(most, __shfl_xor_sync(ALL, most, o));

    const unsigned one = 0x10001u, p1_pair = p1 * one;
    unsigned slack = (p2.data[0] - p1) * one;  // P2 - P1
    __shared__ unsigned short table[256];
    if (ADAPTIVE) {
        table[threadIdx.x] = p2.data[threadIdx.x];
        __syncthreads();
    }
    const long long stride = ((long long)dy * width + dx) * depth;
    const long long begin = ((long long)y * width + x) * depth + lane * (16 * CHUNKS);
    const COST_TYPE* from = costs.data + begin;
    const int rows_kept = lines.shape[1];
    PATH_TYPE* to = lines.data + begin
        + ((long long)(path - first_path) * rows_kept - top) * width * depth;
    const unsigned char* brightness = guide.data + (ADAPTIVE ? y * width + x : 0);
    const int brightness_stride = dy * width + dx;
    bool has[CHUNKS];
    #pragma unroll
    for (int j = 0; j < CHUNKS; ++j) has[j] = (lane * CHUNKS + j) * 16 < depth;

    // Loads run AHEAD pixels before their use.
    uint4 ring[AHEAD][LOADS];
    int grey[AHEAD], grey_before = 0;
    #pragma unroll
    for (int k = 0; k < AHEAD; ++k) {
        #pragma unroll
        for (int j = 0; j < LOADS; ++j) {
            // What lies behind the last disparity costs more than any that counts.
            ring[k][j] = make_uint4(FAR, FAR, FAR, FAR);
            if (k < length && has[j / COST_BYTES])
                ring[k][j] = reinterpret_cast<const uint4*>(from)[j];
        }
        if (ADAPTIVE) {
            grey[k] = k < length ? *brightness : 0;
            brightness += brightness_stride;
        }
        from += stride;
    }
    if (ADAPTIVE) grey_before = grey[0];

    // The recursion less its minimum: v(d) = L(d) - min L. All 0 before the first pixel gives C.
    unsigned v[PAIRS];
    #pragma unroll
    for (int i = 0; i < PAIRS; ++i) v[i] = 0;
    unsigned below = 0, above = 0;  // the neighbours' v
    for (int begun = 0; begun < most; begun += AHEAD) {
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int t = begun + k;
            const bool kept = t < length && (unsigned)(y + t * dy - top) < (unsigned)rows_kept;
            unsigned cost[PAIRS], change[PAIRS];
            #pragma unroll
            for (int j = 0; j < LOADS; ++j) {
                const uint4 c = ring[k][j];
                const unsigned word[4] = {c.x, c.y, c.z, c.w};
                #pragma unroll
                for (int i = 0; i < 4; ++i) {
                    if (COST_BYTES == 1) {
                        cost[(8 * j + 2 * i) % PAIRS] = __byte_perm(word[i], 0, 0x4140);
                        cost[(8 * j + 2 * i + 1) % PAIRS] = __byte_perm(word[i], 0, 0x4342);
                    } else {
                        cost[(4 * j + i) % PAIRS] = word[i];
                    }
                }
                if (t + AHEAD < length && has[j / COST_BYTES])
                    ring[k][j] = reinterpret_cast<const uint4*>(from)[j];
            }
            from += stride;
            if (ADAPTIVE) {
                slack = (table[abs(grey[k] - grey_before)] - p1) * one;
                grey_before = grey[k];
                if (t + AHEAD < length) grey[k] = *brightness;
                brightness += brightness_stride;
            }
            unsigned left = __byte_perm(below, v[0], 0x5432);
            unsigned least = ALL;
            #pragma unroll
            for (int i = 0; i < PAIRS; ++i) {
                // min(v(d), v(d - 1) + P1, v(d + 1) + P1, P2)
                const unsigned next = i + 1 < PAIRS ? v[(i + 1) % PAIRS] : above;
                const unsigned right = __byte_perm(v[i], next, 0x5432);
                const unsigned jump = __vimin3_u16x2(left, right, slack);
                change[i] = __viaddmin_u16x2(jump, p1_pair, v[i]);
                v[i] = cost[i] + change[i];
                if (WHOLE) change[i] = v[i];
                if (i % 2 == 1) least = __vimin3_u16x2(least, v[i - 1], v[i]);
                left = right;
            }
            below = __shfl_up_sync(ALL, v[PAIRS - 1], 1, GROUP);
            above = __shfl_down_sync(ALL, v[0], 1, GROUP);
            least = __vminu2(least, __byte_perm(least, least, 0x1032));
            #if __CUDA_ARCH__ >= 800
            if (GROUP == 32) {
                least = __reduce_min_sync(ALL, least);
            } else
            #endif
            {
                #pragma unroll
                for (int o = GROUP / 2; o > 0; o >>= 1)
                    least = min(least, __shfl_xor_sync(ALL, least, o));
            }
            #pragma unroll
            for (int i = 0; i < PAIRS; ++i) v[i] -= least;
            below = lane == 0 ? 0x7fff0000u : below - least;
            above = lane == GROUP - 1 ? 0x7fffu : above - least;
            #pragma unroll
            for (int j = 0; j < CHUNKS * PATH_BYTES; ++j) {
                unsigned word[4];
                #pragma unroll
                for (int i = 0; i < 4; ++i) {
                    if (PATH_BYTES == 1) {
                        const int pair = (8 * j + 2 * i) % PAIRS;
                        word[i] = __byte_perm(change[pair], change[pair + 1], 0x6420);
                    } else {
                        word[i] = change[4 * j + i];
                    }
                }
                if (kept && has[j / PATH_BYTES])
                    __stcs(reinterpret_cast<uint4*>(to) + j,
                           make_uint4(word[0], word[1], word[2], word[3]));
            }
            to += stride;
        }
    }
"""

C_TYPES = {wp.uint8: "unsigned char", wp.uint16: "unsigned short"}
FAR_COSTS = {wp.uint8: 255, wp.uint16: 1 << 14}  # no cost is larger: 4 paths sum to less than 2^16


def text_of(source: str, **words: Any) -> str:
    """Return the source of a kernel, with values in place of words."""
    for word, value in words.items():
        source = source.replace(word, str(value))
    return source


def lanes(depth: int) -> tuple[int, int]:
    """Return how many threads hold `depth` disparities, and how many chunks of 16 each."""
    chunks = -(-depth // CHUNK)
    group = 4
    while group < 32 and group < chunks:
        group *= 2
    each = 1
    while group * each < chunks:
        each *= 2
    return group, each


@lru_cache
def walk(
    cost_type: Any, line_type: Any, group: int, chunks: int, adaptive: bool, whole: bool
) -> wp.Kernel:
    """Return the kernel that walks paths, for groups of `group` threads of 16 `chunks` costs."""
    steps = ", ".join(f"{{{dy}, {dx}}}" for dy, dx in STEPS)
    text = text_of(
        _WALK,
        STEPS=f"{{{steps}}}",
        COST_BYTES=wp.types.type_size_in_bytes(cost_type),
        PATH_BYTES=wp.types.type_size_in_bytes(line_type),
        COST_TYPE=C_TYPES[cost_type],
        PATH_TYPE=C_TYPES[line_type],
        FAR=f"{FAR_COSTS[cost_type] * (0x1010101 if cost_type is wp.uint8 else 0x10001):#x}u",
        AHEAD=max(1, 4 // (chunks * wp.types.type_size_in_bytes(cost_type))),
        CHUNKS=chunks,
        GROUP=group,
        BLOCK=BLOCK,
        ADAPTIVE=int(adaptive),
        WHOLE=int(whole),
    )

    @wp.func_native(text)
    def walk_path(
        costs: wp.array3d[cost_type],
        guide: wp.array2d[wp.uint8],
        p1: int,
        p2: wp.array[wp.uint16],
        first_path: int,
        top: int,
        lines: wp.array4d[line_type],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def walk(
        costs: wp.array3d[cost_type],  # (H, W, D)
        guide: wp.array2d[wp.uint8],  # (H, W)
        p1: int,
        p2: wp.array[wp.uint16],  # (256,)
        first_path: int,
        top: int,
        # outputs
        lines: wp.array4d[line_type],  # (paths, h, W, D), rows of the image from `top` on
    ):
        walk_path(costs, guide, p1, p2, first_path, top, lines)

    return walk


def path_threads(height: int, width: int, steps: Sequence[tuple[int, int]], group: int) -> int:
    """Return how many threads walk the paths of some directions: whole blocks for each."""
    blocks = 0
    for dy, dx in steps:
        rows, columns = min(abs(dy), height), min(abs(dx), width)
        count = rows * width + columns * (height - rows)
        blocks += -(-count // (BLOCK // group))
    return blocks * BLOCK
