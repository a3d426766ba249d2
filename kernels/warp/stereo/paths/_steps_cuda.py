"""The paths of semi-global matching on CUDA: a group of threads walks one, 16 disparities a thread.

All paths are walked in one launch, the longest first. A path that leaves the image at a side enters
it again at the other, as a new one: so every column begins one path of each direction, all are of
one length, and those that go up or down together read the same costs while a cache holds them.

A thread keeps the costs of its disparities in pairs of 16 bits, which Hopper's instructions for
dynamic programming take at once. What it leaves of path r is L_r, or L_r - C, which the recursion
bounds by P2: mostly one byte. Disparities are padded to a multiple of 16.
"""

import re
from functools import lru_cache
from itertools import groupby
from typing import Any

import warp as wp

# With "default_grid_stride" off, Warp would number the blocks of large launches along three axes.
OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

BLOCK = 256  # threads of a block
WALK_BLOCK = 64  # those of paths: few, to spread the longest over all multiprocessors
CHUNK = 16  # disparities that are loaded together, 16 or 32 bytes

# How paths go, (dy, dx): along rows first, as those are the longest. 16 are taken 8 at a time.
PATHS = {
    4: (((0, 1), (0, -1), (1, 0), (-1, 0)),),
    8: (((0, 1), (0, -1), (1, 0), (1, 1), (1, -1), (-1, 0), (-1, 1), (-1, -1)),),
}
_KNIGHTS = ((1, 2), (1, -2), (-1, 2), (-1, -2), (2, 1), (2, -1), (-2, 1), (-2, -1))
PATHS[16] = (*PATHS[8], _KNIGHTS)

_WALK = """
    const signed char steps[COUNT][2] = STEPS;
    const int sets[SETS][2] = BOUNDS;  // of paths with the same dy: the first, and how many
    const unsigned ALL = 0xffffffffu, FIRST = 0x80000000u;
    const int QUADS = 4 * CHUNKS, LOADS = CHUNKS * COST_BYTES, GROUPS = BLOCK / GROUP;
    const int lane = threadIdx.x % GROUP;
    const int height = costs.shape[0], width = costs.shape[1], depth = costs.shape[2];

    // The paths of a set take blocks by turns.
    int block = blockIdx.x, path = 0, dy = 0, dx = 0, count = 0;
    for (int set = 0; set < SETS; ++set) {
        dy = steps[sets[set][0]][0];
        count = dy == 0 ? height : min(abs(dy), height) * width;
        const int blocks = (count + GROUPS - 1) / GROUPS * sets[set][1];
        path = sets[set][0] + block % sets[set][1];
        if (block < blocks) {
            block /= sets[set][1];
            break;
        }
        block -= blocks;
    }
    dx = steps[path][1];
    // Threads without a path of their own do the last one as well.
    const int number = min(block * GROUPS + threadIdx.x / GROUP, count - 1);
    int y = dy == 0 ? number : number / width, x = dy == 0 ? 0 : number % width;
    const int length = dy == 0 ? width : (height - 1) / abs(dy) + 1;
    if (dy < 0) y = height - 1 - y;
    if (dy == 0 && dx < 0) x = width - 1;

    // Where the next pixel to load is, and whether it is the first of a path (bit 31).
    unsigned place = y * width + x, first = FIRST;
    const int stride = dy * width + dx;
    const int back = (dx < 0 ? -1 : 1) * ((abs(dx) + width - 1) / width) * width;

    // What a step beyond the next neighbour costs, and one to it: P2 - P1 and P1, twice.
    __shared__ unsigned table[256];
    for (int i = threadIdx.x; i < 256; i += BLOCK) table[i] = (p2.data[i] - p1) * 0x10001u;
    __syncthreads();
    const unsigned near = p1 * 0x10001u;
    unsigned far = table[0];

    // Bytes of a pixel, in costs and in lines.
    const unsigned from_pixel = depth * COST_BYTES, to_pixel = depth * PATH_BYTES;
    const unsigned begin = top * width, end = lines.shape[1] * width, last = height * width - 1;
    const char* from = reinterpret_cast<const char*>(costs.data) + lane * CHUNKS * 16 * COST_BYTES;
    char* to = reinterpret_cast<char*>(lines.data) + lane * CHUNKS * 16 * PATH_BYTES
        + ((long long)path * end - begin) * to_pixel;
    bool has[CHUNKS];
    #pragma unroll
    for (int j = 0; j < CHUNKS; ++j) has[j] = FULL || (lane * CHUNKS + j) * 16 < depth;

    // A queue of the next pixels: what is loaded is used AHEAD pixels later. What is walked behind
    // the end of a path is nowhere in the image, or, of a row, the same again.
    uint4 queue[AHEAD][LOADS];
    unsigned places[AHEAD];
    int grey[AHEAD];
    #pragma unroll
    for (int k = 0; k < AHEAD; ++k) {
        grey[k] = 0;
        #pragma unroll
        for (int j = 0; j < LOADS; ++j) queue[k][j] = make_uint4(FAR, FAR, FAR, FAR);
    }
    const auto load = [&](int k) {
        const unsigned inside = min(place, last);
        const uint4* here =
            reinterpret_cast<const uint4*>(from + (unsigned long long)inside * from_pixel);
        #pragma unroll
        for (int j = 0; j < LOADS; ++j)
            if (has[j / COST_BYTES]) queue[k][j] = here[j];
        if (ADAPTIVE) grey[k] = guide.data[inside];
        places[k] = place | first;
        x += dx;
        const bool leaves = (unsigned)x >= (unsigned)width;
        x -= leaves ? back : 0;
        place += leaves ? stride - back : stride;
        first = leaves ? FIRST : 0;
    };
    #pragma unroll
    for (int k = 0; k < AHEAD; ++k) load(k);

    // v(d) = L(d) - min L of the pixel before, of disparities (4q, 4q + 2) and (4q + 1, 4q + 3).
    unsigned even[QUADS], odd[QUADS], below = 0, above = 0;
    #pragma unroll
    for (int q = 0; q < QUADS; ++q) even[q] = odd[q] = 0;
    for (int t = 0; t < length; t += AHEAD) {
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            unsigned cost[2 * QUADS], word[LOADS * 4];
            #pragma unroll
            for (int j = 0; j < LOADS; ++j) {
                word[4 * j] = queue[k][j].x;
                word[4 * j + 1] = queue[k][j].y;
                word[4 * j + 2] = queue[k][j].z;
                word[4 * j + 3] = queue[k][j].w;
            }
            #pragma unroll
            for (int q = 0; q < QUADS; ++q) {
                const unsigned a = word[COST_BYTES * q], b = word[COST_BYTES * (q + 1) - 1];
                cost[2 * q] = COST_BYTES == 1 ? a & 0xff00ffu : __byte_perm(a, b, 0x5410);
                cost[2 * q + 1] =
                    COST_BYTES == 1 ? __byte_perm(a, 0, 0x4341) : __byte_perm(a, b, 0x7632);
            }
            const unsigned at = places[k] & ~FIRST;
            // The first pixel of a path has L = C: nothing before it is cheaper than a free step.
            const unsigned both = places[k] & FIRST ? 0 : ALL;
            const unsigned near_now = near & both, far_now = far & both;
            if (ADAPTIVE) far = table[abs(grey[(k + 1) % AHEAD] - grey[k])];
            load(k);

            unsigned least = ALL, change[2 * QUADS], odd_before = below;
            #pragma unroll
            for (int q = 0; q < QUADS; ++q) {
                // min(v(d), v(d - 1) + P1, v(d + 1) + P1, P2)
                const unsigned low = __byte_perm(odd_before, odd[q], 0x5432);
                const unsigned next = q + 1 < QUADS ? even[(q + 1) % QUADS] : above;
                const unsigned high = __byte_perm(even[q], next, 0x5432);
                change[2 * q] = __viaddmin_u16x2(
                    __vimin3_u16x2(low, odd[q], far_now), near_now, even[q]);
                change[2 * q + 1] = __viaddmin_u16x2(
                    __vimin3_u16x2(even[q], high, far_now), near_now, odd[q]);
                odd_before = odd[q];
                even[q] = cost[2 * q] + change[2 * q];
                odd[q] = cost[2 * q + 1] + change[2 * q + 1];
                least = __vimin3_u16x2(least, even[q], odd[q]);
                if (WHOLE) change[2 * q] = even[q];
                if (WHOLE) change[2 * q + 1] = odd[q];
            }
            below = __shfl_up_sync(ALL, odd[QUADS - 1], 1, GROUP);
            above = __shfl_down_sync(ALL, even[0], 1, GROUP);
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
            for (int q = 0; q < QUADS; ++q) {
                even[q] -= least;
                odd[q] -= least;
            }
            below = lane == 0 ? 0x7fff0000u : below - least;
            above = lane == GROUP - 1 ? 0x7fffu : above - least;

            const bool kept = at - begin < end;
            uint4* out = reinterpret_cast<uint4*>(to + (unsigned long long)at * to_pixel);
            #pragma unroll
            for (int j = 0; j < CHUNKS * PATH_BYTES; ++j) {
                unsigned four[4];
                #pragma unroll
                for (int i = 0; i < 4; ++i) {
                    const int q = (4 * j + i) / PATH_BYTES;
                    if (PATH_BYTES == 1)
                        four[i] = change[2 * q + 1] * 256 + change[2 * q];
                    else
                        four[i] = __byte_perm(
                            change[2 * q], change[2 * q + 1], i % 2 == 0 ? 0x5410 : 0x7632);
                }
                if (kept && has[j / PATH_BYTES])
                    __stcs(out + j, make_uint4(four[0], four[1], four[2], four[3]));
            }
        }
    }
"""

C_TYPES = {wp.uint8: "unsigned char", wp.uint16: "unsigned short"}
FAR_COSTS = {wp.uint8: 255, wp.uint16: 1 << 14}  # none is larger: 4 paths sum to less than 2^16


def text_of(source: str, **words: Any) -> str:
    """Return the source of a kernel, with values in place of words."""
    for word, value in words.items():
        source = re.sub(rf"\b{word}\b", str(value), source)
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
    """Return the kernel that walks `steps`, by `group` threads of 16 `chunks` disparities.

    `full` says that all of them are there.
    """
    cost_bytes = wp.types.type_size_in_bytes(cost_type)
    ahead = 8 if group <= 8 else 4  # with few threads a path, there are few to wait in turns
    sets = [len(list(paths)) for _, paths in groupby(steps, key=lambda step: step[0])]
    bounds = [f"{{{sum(sets[:i])}, {n}}}" for i, n in enumerate(sets)]
    text = text_of(
        _WALK,
        STEPS=f"{{{', '.join(f'{{{dy}, {dx}}}' for dy, dx in steps)}}}",
        BOUNDS=f"{{{', '.join(bounds)}}}",
        SETS=len(sets),
        COUNT=len(steps),
        COST_BYTES=cost_bytes,
        PATH_BYTES=wp.types.type_size_in_bytes(line_type),
        COST_TYPE=C_TYPES[cost_type],
        PATH_TYPE=C_TYPES[line_type],
        FAR=f"{FAR_COSTS[cost_type] * (0x1010101 if cost_bytes == 1 else 0x10001):#x}u",
        AHEAD=max(2, ahead // (chunks * cost_bytes)),
        CHUNKS=chunks,
        GROUP=group,
        BLOCK=WALK_BLOCK,
        FULL=int(full),
        ADAPTIVE=int(adaptive),
        WHOLE=int(whole),
    )

    @wp.func_native(text)
    def walk_path(
        costs: wp.array3d[cost_type],
        guide: wp.array2d[wp.uint8],
        p1: int,
        p2: wp.array[wp.uint16],
        top: int,
        lines: wp.array4d[line_type],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def walk(
        costs: wp.array3d[cost_type],  # (H, W, D)
        guide: wp.array2d[wp.uint8],  # (H, W)
        p1: int,
        p2: wp.array[wp.uint16],  # (256,)
        top: int,
        # outputs
        lines: wp.array4d[line_type],  # (paths, h, W, D), rows of the image from `top` on
    ):
        walk_path(costs, guide, p1, p2, top, lines)

    return walk


def walk_threads(height: int, width: int, depth: int, steps: Steps) -> int:
    """Return how many threads walk: whole blocks for each direction."""
    groups = WALK_BLOCK // lanes(depth)[0]
    counts = [min(abs(dy), height) * width if dy != 0 else height for dy, _ in steps]
    return sum(-(-count // groups) for count in counts) * WALK_BLOCK
