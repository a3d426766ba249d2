"""Winners of both images on CUDA, straight from the volumes that paths leave.

A block takes a tile of a row: it sums the paths of its pixels in shared memory, and picks their
winners there. What the tile says about a pixel of the right image, some diagonal of it, goes into
the minimum of (cost, disparity) that all tiles of the row find for that pixel.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import LARGEST_MATCH_COST, Subpixel
from cvkern.kernels.warp._launch import launch, scratch, view
from cvkern.kernels.warp.stereo._winners_cuda import pick, pick_right

from ._aggregation_cuda import TOTAL, aggregate, walk_paths
from ._costs_cuda import match_costs
from ._steps_cuda import BLOCK, CHUNK, OPTIONS, PATHS, text_of

wp.set_module_options(OPTIONS)

_WINNERS = (
    """
    const unsigned ALL = 0xffffffffu;
    const int PITCH = DEPTH + 16, LANES = BLOCK / TILE;  // a pitch that spreads pixels over banks
    const int width = lines.shape[2], padded = lines.shape[3], chunks = padded / 16;
    const int tiles = (width + TILE - 1) / TILE;
    const int y = blockIdx.x / tiles, begin = blockIdx.x % tiles * TILE;
    const int count = min(TILE, width - begin);
    const long long row = (long long)y * width, pixels = (long long)lines.shape[1] * width;
    __shared__ uint4 shared[TILE * PITCH / 8];
    const unsigned short* sums = reinterpret_cast<const unsigned short*>(shared);
    for (int i = threadIdx.x; i < count * chunks; i += BLOCK) {
        const int pixel = i / chunks, d = i % chunks * 16;
        const long long at = (row + begin + pixel) * padded + d;
"""
    + TOTAL
    + """
        // No sum is 0xffff, as paths * (C + P2) is a multiple of 4 below 2^16.
        #pragma unroll
        for (int j = 0; j < 8; ++j) {
            if (d + 2 * j >= depth) total[j] |= 0xffffu;
            if (d + 2 * j + 1 >= depth) total[j] |= 0xffff0000u;
        }
        uint4* to = shared + (pixel * PITCH + d) / 8;
        to[0] = make_uint4(total[0], total[1], total[2], total[3]);
        to[1] = make_uint4(total[4], total[5], total[6], total[7]);
    }
    __syncthreads();

    // The left image. A key is a sum and its disparity, so that ties go to the smallest.
    {
        const int pixel = threadIdx.x / LANES, lane = threadIdx.x % LANES;
        const unsigned short* here = sums + pixel * PITCH;
        const unsigned* pairs = reinterpret_cast<const unsigned*>(here);
        const int words = pixel < count ? padded / 2 : 0;
        unsigned key = ALL, second = ALL;
        for (int w = lane; w < words; w += LANES)
            key = min(key, min(pairs[w] << 16 | 2 * w, (pairs[w] & 0xffff0000u) | 2 * w + 1));
        #pragma unroll
        for (int o = LANES / 2; o > 0; o >>= 1) key = min(key, __shfl_xor_sync(ALL, key, o));
        const int k = key & 0xffff;
        for (int w = lane; w < words; w += LANES) {
            unsigned far = pairs[w];
            if (abs(2 * w - k) <= 1) far |= 0xffffu;
            if (abs(2 * w + 1 - k) <= 1) far |= 0xffff0000u;
            second = __vminu2(second, far);
        }
        second = min(second & 0xffff, second >> 16);
        #pragma unroll
        for (int o = LANES / 2; o > 0; o >>= 1)
            second = min(second, __shfl_xor_sync(ALL, second, o));
        if (pixel < count && lane == 0) {
            const float best = key >> 16;
            float certain = 0.0f, offset = 0.0f;
            if (second == 0xffff) certain = 1.0f;
            else if (second > key >> 16) certain = __fsub_rn(1.0f, __fdiv_rn(best, second));
            const bool unique = uniqueness == 0 || second == 0xffff
                || second * (100 - uniqueness) >= (key >> 16) * 100;
            if (subpixel != NONE && k > 0 && k < depth - 1) {
                const float a = __fsub_rn(here[k - 1], best), b = __fsub_rn(here[k + 1], best);
                const float m = subpixel == PARABOLA ? __fadd_rn(a, b) : fmaxf(a, b);
                if (m > 0.0f) offset = __fmul_rn(0.5f, __fdiv_rn(__fsub_rn(a, b), m));
            }
            const long long out = row + begin + pixel;
            index.data[out] = unique ? k : -1;
            disparity.data[out] =
                unique ? __fadd_rn(first + k, offset) : __int_as_float(0x7fc00000);
            cost.data[out] = best;
            confidence.data[out] = certain;
        }
    }

    // The right image: disparity k of the pixel in column x is that of column x - first - k.
    for (int j = threadIdx.x; j < count + depth - 1; j += BLOCK) {
        const int x = begin - first - (depth - 1) + j;
        if (x < 0 || x >= width) continue;
        const int last = min(j, count - 1);
        unsigned key = ALL;
        #pragma unroll 8
        for (int i = max(0, j - (depth - 1)); i <= last; ++i) {
            const int k = i + depth - 1 - j;
            key = min(key, (unsigned)sums[i * PITCH + k] << 16 | k);
        }
        atomicMin(reinterpret_cast<unsigned*>(right.data) + row + x, key);
    }
"""
)


MOST_DISPARITIES = 2048  # for which 8 pixels fit into shared memory


def tile(depth: int) -> tuple[int, int]:
    """Return for how many disparities there is shared memory, and for how many pixels."""
    room = 64
    while room < depth:
        room *= 2
    return room, min(64, max(8, 16384 // room))


@lru_cache
def winners(line_type: Any, paths: int, room: int, pixels: int) -> wp.Kernel:
    """Return the kernel for `paths` paths, at most `room` disparities and tiles of `pixels`."""
    text = text_of(
        _WINNERS,
        PATH_BYTES=wp.types.type_size_in_bytes(line_type),
        COUNT=paths,
        DEPTH=room,
        TILE=pixels,
        BLOCK=BLOCK,
        NONE=int(Subpixel.NONE),
        PARABOLA=int(Subpixel.PARABOLA),
    )

    @wp.func_native(text)
    def winners_of_tile(
        lines: wp.array4d[line_type],
        depth: int,
        first: int,
        subpixel: int,
        uniqueness: int,
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
        right: wp.array2d[int],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def winners(
        lines: wp.array4d[line_type],  # (paths, h, W, D rounded up)
        depth: int,
        first: int,
        subpixel: int,
        uniqueness: int,
        # outputs, all (h, W)
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
        right: wp.array2d[int],  # -1 before; keys after
    ):
        winners_of_tile(
            lines, depth, first, subpixel, uniqueness, index, disparity, cost, confidence, right
        )

    return winners


def match(
    left_bits: wp.array,
    right_bits: wp.array,
    left: wp.array,
    right: wp.array,
    first: int,
    count: int,
    p1: int,
    p2: wp.array,
    p2_max: int,
    paths: int,
    subpixel: int,
    uniqueness: int,
    top: int,
    index: wp.array,
    disparity: wp.array,
    cost: wp.array,
    confidence: wp.array,
    right_index: wp.array,
) -> None:
    """Match a pair; sums over more than eight paths, or of many disparities, go to memory."""
    height, width = left.shape
    rows = index.shape[0]
    device = index.device
    padded = -(-count // CHUNK) * CHUNK
    costs = scratch("match.costs", (height, width, padded), wp.uint8, device)
    match_costs(left_bits, right_bits, left, right, first, count, costs)
    outputs = [index, disparity, cost, confidence]
    if len(PATHS[paths]) > 1 or count > MOST_DISPARITIES:
        sums = scratch("match.sums", (rows, width, count), wp.uint16, device)
        aggregate(costs, left, p1, p2, p2_max, paths, top, sums)
        pick(sums, first, subpixel, uniqueness, *outputs)
        pick_right(sums, first, right_index)
        return
    line_type = wp.uint8 if LARGEST_MATCH_COST + p2_max < 256 else wp.uint16
    lines = scratch("match.lines", (paths, rows, width, padded), line_type, device)
    walk_paths(costs, left, p1, p2, PATHS[paths][0], True, top, lines)
    keys = view(right_index, wp.int32, (right_index.size,))
    launch(clear, right_index.size, [], [keys])
    room, pixels = tile(count)
    launch(
        winners(line_type, paths, room, pixels),
        rows * -(-width // pixels) * BLOCK,
        [lines, count, first, subpixel, uniqueness],
        [*outputs, right_index],
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
