"""Winner takes all on CUDA: some threads a pixel of the left image, tiles for the right."""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.codes.stereo import Subpixel
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.stereo.paths._steps_cuda import OPTIONS, text_of

wp.set_module_options(OPTIONS)

BLOCK = 256  # threads of a block


class _Scalar(NamedTuple):
    """What C calls costs of one type, and a type to compare them in, with its largest value."""

    name: str
    wide: str
    most: str


_SCALARS = {
    wp.uint8: _Scalar("unsigned char", "unsigned", "0xffffffffu"),
    wp.uint16: _Scalar("unsigned short", "unsigned", "0xffffffffu"),
    wp.float32: _Scalar("float", "float", "__int_as_float(0x7f800000)"),
}

# LANES threads take a pixel, VECTOR costs at a time.
_PICK = """
    const unsigned ALL = 0xffffffffu;
    const float infinity = __int_as_float(0x7f800000);
    const WIDE most = MOST;
    const int depth = costs.shape[2], lane = threadIdx.x % LANES;
    const unsigned pixels = (unsigned)costs.shape[0] * costs.shape[1];
    const unsigned number = blockIdx.x * (BLOCK / LANES) + threadIdx.x / LANES;
    const unsigned pixel = min(number, pixels - 1);  // the threads of a warp stay together
    const TYPE* here = costs.data + (long long)pixel * depth;
    WIDE best = most, second = most;
    int k = depth;
    for (int d = lane * VECTOR; d < depth; d += LANES * VECTOR) {
        __align__(16) TYPE c[VECTOR];
        if (VECTOR > 1) *reinterpret_cast<uint4*>(c) = *reinterpret_cast<const uint4*>(here + d);
        else c[0] = here[d];
        #pragma unroll
        for (int j = 0; j < VECTOR; ++j) {
            if (c[j] < best) {
                best = c[j];
                k = d + j;
            }
        }
    }
    #pragma unroll
    for (int o = LANES / 2; o > 0; o >>= 1) {
        const WIDE other = __shfl_xor_sync(ALL, best, o);
        const int other_k = __shfl_xor_sync(ALL, k, o);
        if (other < best || (other == best && other_k < k)) {
            best = other;
            k = other_k;
        }
    }
    if (k == depth) k = 0;  // all are infinite
    for (int d = lane * VECTOR; d < depth; d += LANES * VECTOR) {
        __align__(16) TYPE c[VECTOR];
        if (VECTOR > 1) *reinterpret_cast<uint4*>(c) = *reinterpret_cast<const uint4*>(here + d);
        else c[0] = here[d];
        #pragma unroll
        for (int j = 0; j < VECTOR; ++j)
            if (abs(d + j - k) > 1) second = min(second, (WIDE)c[j]);
    }
    #pragma unroll
    for (int o = LANES / 2; o > 0; o >>= 1)
        second = min(second, __shfl_xor_sync(ALL, second, o));
    if (lane != 0 || number >= pixels) return;
    // Float32 holds integer costs, and the products with percentages below, exactly.
    const float least = best, rival = second == most ? infinity : second;
    float certain = 0.0f, offset = 0.0f;
    if (rival > least)
        certain = fminf(fmaxf(__fsub_rn(1.0f, __fdiv_rn(least, rival)), 0.0f), 1.0f);
    const bool unique =
        uniqueness == 0 || __fmul_rn(rival, 100 - uniqueness) >= __fmul_rn(least, 100.0f);
    if (subpixel != NONE && k > 0 && k < depth - 1) {
        const float a = __fsub_rn(here[k - 1], least), b = __fsub_rn(here[k + 1], least);
        const float n = __fsub_rn(a, b), m = subpixel == PARABOLA ? __fadd_rn(a, b) : fmaxf(a, b);
        if (0.0f < m && m < infinity && fabsf(n) < infinity)
            offset = __fmul_rn(0.5f, __fdiv_rn(n, m));
    }
    index.data[pixel] = unique ? k : -1;
    disparity.data[pixel] = unique ? __fadd_rn(first + k, offset) : __int_as_float(0x7fc00000);
    cost.data[pixel] = least;
    confidence.data[pixel] = certain;
"""


@lru_cache
def pick_kernel(scalar: Any, lanes: int, vector: int) -> wp.Kernel:
    """Return the kernel for costs of one type, `lanes` threads a pixel, `vector` costs a load."""
    text = text_of(
        _PICK,
        TYPE=_SCALARS[scalar].name,
        WIDE=_SCALARS[scalar].wide,
        MOST=_SCALARS[scalar].most,
        LANES=lanes,
        VECTOR=vector,
        BLOCK=BLOCK,
        NONE=int(Subpixel.NONE),
        PARABOLA=int(Subpixel.PARABOLA),
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

    @wp.kernel(module="unique", module_options=OPTIONS)
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


def pick(
    costs: wp.array,
    first: int,
    subpixel: int,
    uniqueness: int,
    index: wp.array,
    disparity: wp.array,
    cost: wp.array,
    confidence: wp.array,
) -> None:
    """Find the least cost of each pixel, the disparity between the pixels, and how sure it is."""
    depth = costs.shape[2]
    vector = 16 // wp.types.type_size_in_bytes(costs.dtype)
    if depth % vector != 0 or costs.ptr % 16 != 0:
        vector = 1
    lanes = 1
    while lanes < 32 and 2 * lanes * vector < depth:
        lanes *= 2
    launch(
        pick_kernel(costs.dtype, lanes, vector),
        -(-index.size * lanes // BLOCK) * BLOCK,
        [costs, first, subpixel, uniqueness],
        [index, disparity, cost, confidence],
    )


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
def pick_right_kernel(scalar: Any) -> wp.Kernel:
    """Return the kernel for costs of one type."""

    @wp.func_native(text_of(_PICK_RIGHT, TYPE=_SCALARS[scalar].name, BLOCK=BLOCK))
    def pick_tile(costs: wp.array3d[scalar], first: int, index: wp.array2d[int]): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def pick_right(
        costs: wp.array3d[scalar],  # (H, W, D)
        first: int,
        # outputs
        index: wp.array2d[int],  # (H, W)
    ):
        pick_tile(costs, first, index)

    return pick_right


def pick_right(costs: wp.array, first: int, index: wp.array) -> None:
    """Find the least cost of each pixel of the right image, on the diagonals of the volume."""
    height, width = index.shape
    threads = height * -(-width // BLOCK) * BLOCK
    launch(pick_right_kernel(costs.dtype), threads, [costs, first], [index])


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
