"""Winner takes all on CUDA: a warp a pixel of the left image, tiles of diagonals for the right."""

from functools import lru_cache
from typing import Any

import warp as wp

from ..codes import Subpixel

_OPTIONS = {"enable_backward": False, "fuse_fp": False, "default_grid_stride": False}
wp.set_module_options(_OPTIONS)

BLOCK = 256  # threads of a block, 8 warps
_C_TYPES = {wp.uint8: "unsigned char", wp.uint16: "unsigned short", wp.float32: "float"}

_PICK = """
    const unsigned ALL = 0xffffffffu;
    const int depth = costs.shape[2], lane = threadIdx.x % 32;
    const unsigned pixel = (blockIdx.x * BLOCK + threadIdx.x) / 32;
    if (pixel >= (unsigned)costs.shape[0] * costs.shape[1]) return;
    const TYPE* here = costs.data + (long long)pixel * depth;
    const float infinity = __int_as_float(0x7f800000);
    // Float32 holds integer costs, and the products with percentages below, exactly.
    float best = infinity, second = infinity;
    int k = depth;
    for (int d = lane; d < depth; d += 32) {
        const float c = here[d];
        if (c < best) {
            best = c;
            k = d;
        }
    }
    #pragma unroll
    for (int o = 16; o > 0; o >>= 1) {
        const float other = __shfl_xor_sync(ALL, best, o);
        const int other_k = __shfl_xor_sync(ALL, k, o);
        if (other < best || (other == best && other_k < k)) {
            best = other;
            k = other_k;
        }
    }
    if (k == depth) k = 0;  // all are infinite
    for (int d = lane; d < depth; d += 32)
        if (abs(d - k) > 1) second = fminf(second, here[d]);
    #pragma unroll
    for (int o = 16; o > 0; o >>= 1) second = fminf(second, __shfl_xor_sync(ALL, second, o));
    if (lane != 0) return;
    float certain = 0.0f, offset = 0.0f;
    if (second > best)
        certain = fminf(fmaxf(__fsub_rn(1.0f, __fdiv_rn(best, second)), 0.0f), 1.0f);
    const bool unique =
        uniqueness == 0 || __fmul_rn(second, 100 - uniqueness) >= __fmul_rn(best, 100.0f);
    if (subpixel != NONE && k > 0 && k < depth - 1) {
        const float a = __fsub_rn(here[k - 1], best), b = __fsub_rn(here[k + 1], best);
        const float n = __fsub_rn(a, b), m = subpixel == PARABOLA ? __fadd_rn(a, b) : fmaxf(a, b);
        if (0.0f < m && m < infinity && fabsf(n) < infinity)
            offset = __fmul_rn(0.5f, __fdiv_rn(n, m));
    }
    index.data[pixel] = unique ? k : -1;
    disparity.data[pixel] = unique ? __fadd_rn(first + k, offset) : __int_as_float(0x7fc00000);
    cost.data[pixel] = best;
    confidence.data[pixel] = certain;
"""


@lru_cache
def pick(scalar: Any) -> wp.Kernel:
    """Return the kernel for costs of one type."""
    text = (
        _PICK.replace("TYPE", _C_TYPES[scalar])
        .replace("BLOCK", str(BLOCK))
        .replace("NONE", str(int(Subpixel.NONE)))
        .replace("PARABOLA", str(int(Subpixel.PARABOLA)))
    )

    @wp.func_native(text)
    def pick_pixel(
        costs: wp.array3d[scalar],
        first: int,
        subpixel: int,
        uniqueness: int,
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def pick(
        costs: wp.array3d[scalar],  # (H, W, D)
        first: int,
        subpixel: int,
        uniqueness: int,
        # outputs, all (H, W)
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
    ):
        pick_pixel(costs, first, subpixel, uniqueness, index, disparity, cost, confidence)

    return pick


# A block takes the right pixels of a tile, in steps of 32 disparities: what a step needs lies in
# as many more columns of the left image, and is loaded by rows into shared memory.
_PICK_RIGHT = """
    const int width = costs.shape[1], depth = costs.shape[2];
    const int tiles = (width + BLOCK - 1) / BLOCK;
    const int y = blockIdx.x / tiles, begin = blockIdx.x % tiles * BLOCK;
    const TYPE* row = costs.data + (long long)y * width * depth;
    __shared__ TYPE tile[BLOCK + 32][33];
    TYPE best = 0;
    int k = -1;
    for (int base = 0; base < depth; base += 32) {
        const int lane = threadIdx.x % 32;
        for (int i = threadIdx.x / 32; i < BLOCK + 32; i += BLOCK / 32) {
            const int x = begin + first + base + i;
            if (x >= 0 && x < width && base + lane < depth)
                tile[i][lane] = row[(long long)x * depth + base + lane];
        }
        __syncthreads();
        #pragma unroll 8
        for (int j = 0; j < 32; ++j) {
            const int x = begin + threadIdx.x + first + base + j;
            if (x >= 0 && x < width && base + j < depth) {
                const TYPE c = tile[threadIdx.x + j][j];
                if (k < 0 || c < best) {
                    best = c;
                    k = base + j;
                }
            }
        }
        __syncthreads();
    }
    if (begin + threadIdx.x < width) index.data[(long long)y * width + begin + threadIdx.x] = k;
"""


@lru_cache
def pick_right(scalar: Any) -> wp.Kernel:
    """Return the kernel for costs of one type."""

    @wp.func_native(_PICK_RIGHT.replace("TYPE", _C_TYPES[scalar]).replace("BLOCK", str(BLOCK)))
    def pick_tile(costs: wp.array3d[scalar], first: int, index: wp.array2d[int]): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def pick_right(
        costs: wp.array3d[scalar],  # (H, W, D)
        first: int,
        # outputs
        index: wp.array2d[int],  # (H, W)
    ):
        pick_tile(costs, first, index)

    return pick_right


@wp.kernel
def largest(
    costs: wp.array3d[wp.uint16],  # (H, W, D)
    # outputs
    most: wp.array2d[int],  # (H, W)
):
    y, x = wp.tid()
    m = wp.uint16(0)
    for d in range(costs.shape[2]):
        m = wp.max(m, costs[y, x, d])
    most[y, x] = int(m)
