"""Matching by windows on CUDA: a block a tile of columns, which goes down a strip of rows.

The sums of Hamming distances down the columns stay in shared memory, those of two disparities in a
word: no half of a word is ever negative or more than 16 bits, so whole words are added. A warp sums
them along the row, its threads the disparities, and picks the winner of each pixel. The winners of
the right image are the least of keys, the cost above and the disparity below.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.stereo import Subpixel
from cvkern.kernels.warp._launch import launch, scratch

_OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(_OPTIONS)

WORDS = (1, 2, 4, 8)  # of 64 disparities, that a thread has its part of
_BLOCK = 256
_SHARED_WORDS = 9216  # for the sums: 36 KiB of the 48 that a block may have
_FEWEST_COLUMNS = 16  # of a tile, beside those that its windows reach
_BLOCKS = 1056  # that keep a large GPU busy

_MATCH = """
    const int SPAN = 64 * WORDS, MOST = SPAN - 1, WARPS = BLOCK / 32;
    __shared__ unsigned columns[COLUMNS * 32 * WORDS];
    __shared__ unsigned right_keys[COLUMNS + SPAN];
    __shared__ unsigned left_words[2][COLUMNS], right_words[2][COLUMNS + SPAN];
    const unsigned ALL = 0xffffffffu;
    const int height = left.shape[0], width = left.shape[1];
    const int thread = threadIdx.x, lane = thread % 32, warp = thread / 32;
    const int tile = COLUMNS - 2 * radius_x, tiles = (width + tile - 1) / tile;
    const int begin = blockIdx.x % tiles * tile, size = min(tile, width - begin);
    const int top = blockIdx.x / tiles * rows, bottom = min(top + rows, height);
    const int wide = size + 2 * radius_x;
    // Words are the lower halves of what is given. Place i of the right ones is for disparity k at
    // place i - MOST + k of the left ones.
    const auto load = [&](int which, int y) {
        const size_t row = (size_t)max(0, min(height - 1, y)) * width;
        const uint2* l = (const uint2*)left.data + row;
        const uint2* r = (const uint2*)right.data + row;
        const int x = begin - radius_x;
        for (int i = thread; i < wide; i += BLOCK)
            left_words[which][i] = l[max(0, min(width - 1, x + i))].x;
        for (int i = thread; i < wide + MOST; i += BLOCK)
            right_words[which][i] = r[max(0, min(width - 1, x - first - MOST + i))].x;
    };
    const auto distances = [&](int which, int i, int k) {
        const unsigned word = left_words[which][i];
        const unsigned* others = right_words[which] + i + MOST - k;
        return __popc(word ^ others[0]) | __popc(word ^ others[-32]) << 16;
    };
    const auto least_of_warp = [&](unsigned value) {
    #if __CUDA_ARCH__ >= 800
        return __reduce_min_sync(ALL, value);
    #else
        for (int o = 16; o > 0; o >>= 1) value = min(value, __shfl_xor_sync(ALL, value, o));
        return value;
    #endif
    };
    for (int i = thread; i < COLUMNS * 32 * WORDS; i += BLOCK) columns[i] = 0;
    for (int i = thread; i < COLUMNS + SPAN; i += BLOCK) right_keys[i] = ALL;
    for (int y = top - radius_y; y < top + radius_y; ++y) {
        load(0, y);
        __syncthreads();
        for (int i = warp; i < wide; i += WARPS)
            for (int w = 0; w < WORDS; ++w)
                columns[(i * WORDS + w) * 32 + lane] += distances(0, i, lane + 64 * w);
        __syncthreads();
    }
    for (int y = top; y < bottom; ++y) {
        load(0, y + radius_y);
        if (y > top) load(1, y - radius_y - 1);
        __syncthreads();
        for (int i = warp; i < wide; i += WARPS)
            #pragma unroll
            for (int w = 0; w < WORDS; ++w) {
                unsigned change = distances(0, i, lane + 64 * w);
                if (y > top) change -= distances(1, i, lane + 64 * w);
                columns[(i * WORDS + w) * 32 + lane] += change;
            }
        __syncthreads();
        const int run = (size + WARPS - 1) / WARPS;
        const int from = min(warp * run, size), end = min(from + run, size);
        unsigned sums[WORDS];
        #pragma unroll
        for (int w = 0; w < WORDS; ++w) {
            sums[w] = 0;
            for (int i = 0; i < 2 * radius_x; ++i)
                sums[w] += columns[((from + i) * WORDS + w) * 32 + lane];
        }
        for (int x = from; x < end; ++x) {
            unsigned least = ALL;
            #pragma unroll
            for (int w = 0; w < WORDS; ++w) {
                sums[w] += columns[((x + 2 * radius_x) * WORDS + w) * 32 + lane];
                #pragma unroll
                for (int h = 0; h < 2; ++h) {
                    const int k = lane + 64 * w + 32 * h;
                    if (k >= count) continue;
                    const unsigned key = (h ? sums[w] & 0xffff0000u : sums[w] << 16) | k;
                    least = min(least, key);
                    atomicMin(&right_keys[x + MOST - k], key);
                }
            }
            least = least_of_warp(least);
            const int at = least & 0xffff, best = least >> 16;
            unsigned second = 65535, before = 0, after = 0;
            #pragma unroll
            for (int w = 0; w < WORDS; ++w)
                #pragma unroll
                for (int h = 0; h < 2; ++h) {
                    const int k = lane + 64 * w + 32 * h;
                    const unsigned sum = h ? sums[w] >> 16 : sums[w] & 0xffff;
                    if (k < count && abs(k - at) > 1) second = min(second, sum);
                    if ((at - 1) / 32 == k / 32) before = sum;
                    if ((at + 1) / 32 == k / 32) after = sum;
                }
            second = least_of_warp(second);
            before = __shfl_sync(ALL, before, (at - 1) & 31);
            after = __shfl_sync(ALL, after, (at + 1) & 31);
            #pragma unroll
            for (int w = 0; w < WORDS; ++w) sums[w] -= columns[(x * WORDS + w) * 32 + lane];
            if (lane != 0) continue;
            // As in stereo/costs/_windows_cpu.py.
            const size_t pixel = (size_t)y * width + begin + x;
            const bool alone = second == 65535;
            float certain = alone ? 1.0f : 0.0f;
            if (!alone && (int)second > best)
                certain = __fsub_rn(1.0f, __fdiv_rn((float)best, (float)second));
            cost.data[pixel] = (float)best;
            confidence.data[pixel] = certain;
            const bool unique = alone || (int)second * (100 - uniqueness) >= best * 100;
            float offset = 0.0f;
            if (subpixel != NONE && at > 0 && at + 1 < count) {
                const int a = (int)before - best, b = (int)after - best;
                const int m = subpixel == PARABOLA ? a + b : max(a, b);
                if (m > 0) offset = __fmul_rn(0.5f, __fdiv_rn((float)(a - b), (float)m));
            }
            index.data[pixel] = unique ? at : -1;
            disparity.data[pixel] =
                unique ? __fadd_rn((float)(first + at), offset) : __int_as_float(0x7fc00000);
        }
        __syncthreads();
        for (int i = thread; i < size + MOST; i += BLOCK) {
            const unsigned key = right_keys[i];
            const int x = begin - first - MOST + i;
            if (key != ALL && x >= 0 && x < width)
                atomicMin((unsigned*)keys.data + (size_t)y * width + x, key);
            right_keys[i] = ALL;
        }
    }
"""


def columns_of(words: int) -> int:
    """Return how many columns of sums fit into shared memory."""
    return _SHARED_WORDS // (32 * words)


@lru_cache
def match_kernel(words: int) -> wp.Kernel:
    """Return the kernel for up to 64 `words` disparities, compiled when it is first used."""
    text = _MATCH
    for name, value in {
        "COLUMNS": columns_of(words),
        "WORDS": words,
        "BLOCK": _BLOCK,
        "NONE": int(Subpixel.NONE),
        "PARABOLA": int(Subpixel.PARABOLA),
    }.items():
        text = text.replace(name, str(value))

    @wp.func_native(text)
    def match_tile(
        left: wp.array3d[wp.uint64],
        right: wp.array3d[wp.uint64],
        first: int,
        count: int,
        radius_y: int,
        radius_x: int,
        subpixel: int,
        uniqueness: int,
        rows: int,
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
        keys: wp.array2d[wp.uint32],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS, launch_bounds=(_BLOCK, 4))
    def match(
        left: wp.array3d[wp.uint64],  # (H, W, 1), no more than 32 bits each
        right: wp.array3d[wp.uint64],
        first: int,
        count: int,
        radius_y: int,
        radius_x: int,
        subpixel: int,
        uniqueness: int,
        rows: int,  # that a block makes
        # outputs, (H, W)
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
        keys: wp.array2d[wp.uint32],  # of the right image, all bits set before
    ):
        match_tile(
            left, right, first, count, radius_y, radius_x, subpixel, uniqueness, rows,
            index, disparity, cost, confidence, keys,
        )  # fmt: skip

    return match


@wp.kernel
def clear_keys(
    # outputs
    keys: wp.array[wp.uint32],
):
    keys[wp.tid()] = wp.uint32(0xFFFFFFFF)


@wp.kernel
def disparities_of_keys(
    keys: wp.array[wp.uint32],
    # outputs
    index: wp.array[int],
):
    i = wp.tid()
    index[i] = wp.where(keys[i] == wp.uint32(0xFFFFFFFF), -1, int(keys[i] & wp.uint32(0xFFFF)))


def words_for(count: int, radius_x: int) -> int:
    """Return how many words of disparities a thread has; 0 if no kernel has room for them."""
    fitting = (words for words in WORDS if count <= 64 * words)
    words = next(fitting, 0)
    return words if words and columns_of(words) >= 2 * radius_x + _FEWEST_COLUMNS else 0


def match_words(
    left: wp.array,
    right: wp.array,
    first: int,
    count: int,
    radius_y: int,
    radius_x: int,
    subpixel: int,
    uniqueness: int,
    winners: list[wp.array],
    right_index: wp.array,
) -> None:
    """Match (H, W, 1) of 32 bits, as far as `words_for` allows."""
    height, width, _ = left.shape
    words = words_for(count, radius_x)
    tiles = -(-width // (columns_of(words) - 2 * radius_x))
    rows = max(8, min(64, -(-height * tiles // _BLOCKS)))
    keys = scratch("match.keys", (height, width), wp.uint32, left.device)
    launch(clear_keys, keys.size, [], [keys.flatten()])
    launch(
        match_kernel(words),
        tiles * -(-height // rows) * _BLOCK,
        [left, right, first, count, radius_y, radius_x, subpixel, uniqueness, rows],
        [*winners, keys],
    )
    launch(disparities_of_keys, keys.size, [keys.flatten()], [right_index.flatten()])
