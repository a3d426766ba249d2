"""Layers of a perceptron on CUDA, in float16 on the tensor cores.

A warp keeps 16 samples in registers as `mma.m16n8k16` wants them: lane 4 g + t has samples g and
g + 8. Which column of a matrix is which k or n of the instruction is ours to choose, as long as
both operands agree. Here the four columns of a lane in each group of 16 are 4 t to 4 t + 3, which
lie together in memory; an 8 x 8 piece has columns 4 t and 4 t + 1 of them, or 4 t + 2 and 4 t + 3.
"""

from functools import cache

import warp as wp

from cvkern.kernels.warp._launch import BLOCK

from ._tensor_cores_cuda import INSTRUCTIONS

WARPS = BLOCK // 32
TILE = 64  # columns that a block makes at most, of however many there are
OPTIONS = {"enable_backward": False}

_WARP = f"""
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    const int rows = total.data[0];
    {INSTRUCTIONS}
    auto four = [&](const unsigned short* from, int row, int pitch) {{  // columns of a row
        return row < rows ? *(const uint2*)(from + (size_t)row * pitch) : make_uint2(0u, 0u);
    }};
"""

# dst = src w, or src w^T if TRANSPOSED, of depth K_SIZE. A block makes N_SIZE columns; its part of
# w is in shared memory, in the order of the pieces.
_PRODUCT = f"""{_WARP}
    constexpr int DEPTH = K_SIZE / 16, PIECES = N_SIZE / 8;
    __shared__ uint2 pieces[DEPTH * PIECES * 32];
    const unsigned short* weights = (const unsigned short*)w.data;
    const int tiles = columns / N_SIZE, blocks = gridDim.x / tiles;
    const int n0 = blockIdx.x % tiles * N_SIZE, pitch_w = w.shape[1];
    for (int i = threadIdx.x; i < DEPTH * PIECES * 32; i += {BLOCK}) {{
        const int gi = i % 32 / 4, ti = i % 4, piece = i / 32 % PIECES;
        const int k = i / (32 * PIECES) * 16 + 4 * ti;
        const int n = n0 + piece / 2 * 16 + 4 * (gi >> 1) + 2 * (piece & 1) + (gi & 1);
        unsigned int v[4];
        for (int j = 0; j < 4; ++j) {{
            const int at = TRANSPOSED ? n * pitch_w + k + j : (k + j) * pitch_w + n;
            v[j] = weights[at];
        }}
        pieces[i] = make_uint2(v[0] | v[1] << 16, v[2] | v[3] << 16);
    }}
    __syncthreads();
    const int pitch_in = src.shape[1], pitch_out = dst.shape[1];
    const unsigned short* from = (const unsigned short*)src.data + column_in + 4 * t;
    const unsigned short* gate = (const unsigned short*)gates.data + n0 + 4 * t;
    unsigned short* to = (unsigned short*)dst.data + column_out + n0 + 4 * t;
    const int stride = blocks * {WARPS} * 16;
    for (int row = (blockIdx.x / tiles * {WARPS} + warp) * 16 + g; row - g < rows; row += stride) {{
        uint2 low[DEPTH], high[DEPTH];
        #pragma unroll
        for (int k = 0; k < DEPTH; ++k) {{
            low[k] = four(from + 16 * k, row, pitch_in);
            high[k] = four(from + 16 * k, row + 8, pitch_in);
        }}
        float sums[PIECES][4] = {{}};
        #pragma unroll
        for (int k = 0; k < DEPTH; ++k) {{
            const unsigned int a[4] = {{low[k].x, high[k].x, low[k].y, high[k].y}};
            #pragma unroll
            for (int n = 0; n < PIECES; ++n) {{
                const uint2 b = pieces[(k * PIECES + n) * 32 + lane];
                mma(sums[n], a, b.x, b.y);
            }}
        }}
        #pragma unroll
        for (int n = 0; n < PIECES; n += 2)
            #pragma unroll
            for (int half = 0; half < 4; half += 2) {{
                const int line = row + 4 * half;
                if (line >= rows) continue;
                float v[4] = {{
                    sums[n][half], sums[n][half + 1], sums[n + 1][half], sums[n + 1][half + 1]}};
                if (relu)
                    for (int j = 0; j < 4; ++j) v[j] = v[j] > 0.0f ? v[j] : 0.0f;
                if (gated) {{  // the layer before had a rectifier: 0 where it gave 0
                    const uint2 z = four(gate + 8 * n, line, gates.shape[1]);
                    v[0] = z.x & 0xffffu ? v[0] : 0.0f;
                    v[1] = z.x >> 16 ? v[1] : 0.0f;
                    v[2] = z.y & 0xffffu ? v[2] : 0.0f;
                    v[3] = z.y >> 16 ? v[3] : 0.0f;
                }}
                const uint2 out = make_uint2(pack(v[0], v[1]), pack(v[2], v[3]));
                *(uint2*)(to + (size_t)line * pitch_out + 8 * n) = out;
            }}
    }}
"""

# A block's part of K_SIZE x N_SIZE numbers of src^T dy. An 8 x 8 piece turned by `movmatrix` has
# the samples where the instruction sums. The warps' sums are added one after the other, and the
# blocks' by radiance/_sums_cuda.py: always in the same order.
_OUTER = f"""{_WARP}
    constexpr int INS = K_SIZE / 16, OUTS = N_SIZE / 16;
    __shared__ float sums[K_SIZE * N_SIZE];
    const int tiles_n = parts.shape[2] / N_SIZE, blocks = parts.shape[0];
    const int tiles = parts.shape[1] / K_SIZE * tiles_n;
    const int k0 = blockIdx.x % tiles / tiles_n * K_SIZE, n0 = blockIdx.x % tiles_n * N_SIZE;
    const unsigned short* xs = (const unsigned short*)src.data + k0 + 4 * t;
    const unsigned short* ys = (const unsigned short*)dy.data + column + n0 + 4 * t;
    auto turn = [](unsigned int piece) {{
        unsigned int turned;
        asm volatile("movmatrix.sync.aligned.m8n8.trans.b16 %0, %1;" : "=r"(turned) : "r"(piece));
        return turned;
    }};
    float acc[INS][2 * OUTS][4] = {{}};
    const int stride = blocks * {WARPS} * 16;
    for (int row = (blockIdx.x / tiles * {WARPS} + warp) * 16 + g; row - g < rows; row += stride) {{
        uint2 low[INS], high[INS], below[OUTS], above[OUTS];
        #pragma unroll
        for (int i = 0; i < INS; ++i) {{
            low[i] = four(xs + 16 * i, row, src.shape[1]);
            high[i] = four(xs + 16 * i, row + 8, src.shape[1]);
        }}
        #pragma unroll
        for (int o = 0; o < OUTS; ++o) {{
            below[o] = four(ys + 16 * o, row, dy.shape[1]);
            above[o] = four(ys + 16 * o, row + 8, dy.shape[1]);
        }}
        #pragma unroll
        for (int o = 0; o < OUTS; ++o) {{
            below[o] = make_uint2(turn(below[o].x), turn(below[o].y));
            above[o] = make_uint2(turn(above[o].x), turn(above[o].y));
        }}
        #pragma unroll
        for (int i = 0; i < INS; ++i) {{
            const unsigned int a[4] = {{
                turn(low[i].x), turn(low[i].y), turn(high[i].x), turn(high[i].y)}};
            #pragma unroll
            for (int o = 0; o < OUTS; ++o) {{
                mma(acc[i][2 * o], a, below[o].x, above[o].x);
                mma(acc[i][2 * o + 1], a, below[o].y, above[o].y);
            }}
        }}
    }}
    for (int adder = 0; adder < {WARPS}; ++adder) {{
        if (warp == adder) {{
            #pragma unroll
            for (int i = 0; i < INS; ++i)
                #pragma unroll
                for (int o = 0; o < 2 * OUTS; ++o)
                    #pragma unroll
                    for (int j = 0; j < 4; ++j) {{
                        const int k = 16 * i + 4 * (g >> 1) + (g & 1) + (j & 2);
                        const int n = 16 * (o / 2) + 4 * t + (j & 1) + 2 * (o & 1);
                        float& sum = sums[k * N_SIZE + n];
                        sum = adder ? sum + acc[i][o][j] : acc[i][o][j];
                    }}
        }}
        __syncthreads();
    }}
    float* part = parts.data + (size_t)(blockIdx.x / tiles) * parts.shape[1] * parts.shape[2];
    for (int i = threadIdx.x; i < K_SIZE * N_SIZE; i += {BLOCK})
        part[(k0 + i / N_SIZE) * parts.shape[2] + n0 + i % N_SIZE] = sums[i];
"""


def tile(size: int) -> int:
    """Return the largest tile that divides a multiple of 16 evenly."""
    return max(part for part in range(16, TILE + 1, 16) if size % part == 0)


@cache
def product(depth: int, tile: int, transposed: bool) -> wp.Kernel:
    """Return the kernel of ``dst = src w`` for a depth, in tiles of so many columns."""
    text = _PRODUCT.replace("K_SIZE", str(depth)).replace("N_SIZE", str(tile))

    @wp.func_native(text.replace("TRANSPOSED", "true" if transposed else "false"))
    def multiply(
        src: wp.array2d[wp.float16],
        w: wp.array2d[wp.float16],
        gates: wp.array2d[wp.float16],
        total: wp.array[int],
        columns: int,
        column_in: int,
        column_out: int,
        relu: bool,
        gated: bool,
        dst: wp.array2d[wp.float16],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def product(
        src: wp.array2d[wp.float16],  # (M, >= depth)
        w: wp.array2d[wp.float16],  # (depth, columns), or the other way round where transposed
        gates: wp.array2d[wp.float16],  # (M, columns)
        total: wp.array[int],  # (1,)
        columns: int,
        column_in: int,
        column_out: int,
        relu: bool,
        gated: bool,
        # outputs
        dst: wp.array2d[wp.float16],  # (M, >= columns)
    ):
        multiply(src, w, gates, total, columns, column_in, column_out, relu, gated, dst)

    return product


@cache
def outer(depth: int, columns: int) -> wp.Kernel:
    """Return the kernel of P parts of ``src^T dy``, in tiles of depth x columns."""

    @wp.func_native(_OUTER.replace("K_SIZE", str(depth)).replace("N_SIZE", str(columns)))
    def accumulate(
        dy: wp.array2d[wp.float16],
        src: wp.array2d[wp.float16],
        total: wp.array[int],
        column: int,
        parts: wp.array3d[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def outer(
        dy: wp.array2d[wp.float16],  # (M, >= columns)
        src: wp.array2d[wp.float16],  # (M, >= K)
        total: wp.array[int],  # (1,)
        column: int,
        # outputs
        parts: wp.array3d[float],  # (P, K, N)
    ):
        accumulate(dy, src, total, column, parts)

    return outer
