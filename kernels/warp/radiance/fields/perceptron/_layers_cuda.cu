#include "_tensor_cores.cu"

// needs K_SIZE, N_SIZE, TRANSPOSED, WARPS
// dst = src w, or src w^T if TRANSPOSED, of depth K_SIZE. A block computes N_SIZE columns; its part
// of w is in shared memory, in the order of the pieces.
void multiply(wp::array_t<wp::half> src, wp::array_t<wp::half> w, wp::array_t<wp::half> gates,
              wp::array_t<int> total, Product product, wp::array_t<wp::half> dst) {
    using Cores = TensorCores;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    const int rows = total.data[0];
    constexpr int DEPTH = K_SIZE / 16, PIECES = N_SIZE / 8;
    __shared__ uint2 pieces[DEPTH * PIECES * 32];
    const unsigned short* weights = (const unsigned short*)w.data;
    const int tiles = product.columns / N_SIZE, blocks = gridDim.x / tiles;
    const int n0 = blockIdx.x % tiles * N_SIZE, pitch_w = w.shape[1];
    for (int i = threadIdx.x; i < DEPTH * PIECES * 32; i += 32 * WARPS) {
        const int gi = i % 32 / 4, ti = i % 4, piece = i / 32 % PIECES;
        const int k = i / (32 * PIECES) * 16 + 4 * ti;
        const int n = n0 + piece / 2 * 16 + 4 * (gi >> 1) + 2 * (piece & 1) + (gi & 1);
        unsigned int v[4];
        for (int j = 0; j < 4; ++j) {
            const int at = TRANSPOSED ? n * pitch_w + k + j : (k + j) * pitch_w + n;
            v[j] = weights[at];
        }
        pieces[i] = make_uint2(v[0] | v[1] << 16, v[2] | v[3] << 16);
    }
    __syncthreads();
    const int pitch_in = src.shape[1], pitch_out = dst.shape[1];
    const unsigned short* from = (const unsigned short*)src.data + product.column_in + 4 * t;
    const unsigned short* gate = (const unsigned short*)gates.data + n0 + 4 * t;
    unsigned short* to = (unsigned short*)dst.data + product.column_out + n0 + 4 * t;
    const int stride = blocks * WARPS * 16;
    for (int row = (blockIdx.x / tiles * WARPS + warp) * 16 + g; row - g < rows; row += stride) {
        uint2 low[DEPTH], high[DEPTH];
#pragma unroll
        for (int k = 0; k < DEPTH; ++k) {
            low[k] = Cores::four(from + 16 * k, row, rows, pitch_in);
            high[k] = Cores::four(from + 16 * k, row + 8, rows, pitch_in);
        }
        float sums[PIECES][4] = {};
#pragma unroll
        for (int k = 0; k < DEPTH; ++k) {
            const unsigned int a[4] = {low[k].x, high[k].x, low[k].y, high[k].y};
#pragma unroll
            for (int n = 0; n < PIECES; ++n) {
                const uint2 b = pieces[(k * PIECES + n) * 32 + lane];
                Cores::mma(sums[n], a, b.x, b.y);
            }
        }
#pragma unroll
        for (int n = 0; n < PIECES; n += 2)
#pragma unroll
            for (int half = 0; half < 4; half += 2) {
                const int line = row + 4 * half;
                if (line >= rows) continue;
                float v[4] = {sums[n][half], sums[n][half + 1], sums[n + 1][half],
                              sums[n + 1][half + 1]};
                if (product.relu)
                    for (int j = 0; j < 4; ++j) v[j] = v[j] > 0.0f ? v[j] : 0.0f;
                if (product.gated) {  // 0 where the rectifier before gave 0
                    const uint2 z = Cores::four(gate + 8 * n, line, rows, gates.shape[1]);
                    v[0] = z.x & 0xffffu ? v[0] : 0.0f;
                    v[1] = z.x >> 16 ? v[1] : 0.0f;
                    v[2] = z.y & 0xffffu ? v[2] : 0.0f;
                    v[3] = z.y >> 16 ? v[3] : 0.0f;
                }
                const uint2 out = make_uint2(Cores::pack(v[0], v[1]), Cores::pack(v[2], v[3]));
                *(uint2*)(to + (size_t)line * pitch_out + 8 * n) = out;
            }
    }
}

// needs K_SIZE, N_SIZE, WARPS
// A block's part of K_SIZE x N_SIZE numbers of src^T dy. The 8 x 8 pieces are transposed, so that
// the instruction sums over samples. The sums of the warps are added one after the other, and those
// of the blocks by radiance/_sums_cuda.py, so the order is always the same.
void accumulate(wp::array_t<wp::half> dy, wp::array_t<wp::half> src, wp::array_t<int> total,
                int column, wp::array_t<float> parts) {
    using Cores = TensorCores;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    const int rows = total.data[0];
    constexpr int INS = K_SIZE / 16, OUTS = N_SIZE / 16;
    __shared__ float sums[K_SIZE * N_SIZE];
    const int tiles_n = parts.shape[2] / N_SIZE, blocks = parts.shape[0];
    const int tiles = parts.shape[1] / K_SIZE * tiles_n;
    const int k0 = blockIdx.x % tiles / tiles_n * K_SIZE, n0 = blockIdx.x % tiles_n * N_SIZE;
    const unsigned short* xs = (const unsigned short*)src.data + k0 + 4 * t;
    const unsigned short* ys = (const unsigned short*)dy.data + column + n0 + 4 * t;
    float acc[INS][2 * OUTS][4] = {};
    const int stride = blocks * WARPS * 16;
    for (int row = (blockIdx.x / tiles * WARPS + warp) * 16 + g; row - g < rows; row += stride) {
        uint2 low[INS], high[INS], below[OUTS], above[OUTS];
#pragma unroll
        for (int i = 0; i < INS; ++i) {
            low[i] = Cores::four(xs + 16 * i, row, rows, src.shape[1]);
            high[i] = Cores::four(xs + 16 * i, row + 8, rows, src.shape[1]);
        }
#pragma unroll
        for (int o = 0; o < OUTS; ++o) {
            below[o] = Cores::four(ys + 16 * o, row, rows, dy.shape[1]);
            above[o] = Cores::four(ys + 16 * o, row + 8, rows, dy.shape[1]);
        }
#pragma unroll
        for (int o = 0; o < OUTS; ++o) {
            below[o] = make_uint2(Cores::turn(below[o].x), Cores::turn(below[o].y));
            above[o] = make_uint2(Cores::turn(above[o].x), Cores::turn(above[o].y));
        }
#pragma unroll
        for (int i = 0; i < INS; ++i) {
            const unsigned int a[4] = {Cores::turn(low[i].x), Cores::turn(low[i].y),
                                       Cores::turn(high[i].x), Cores::turn(high[i].y)};
#pragma unroll
            for (int o = 0; o < OUTS; ++o) {
                Cores::mma(acc[i][2 * o], a, below[o].x, above[o].x);
                Cores::mma(acc[i][2 * o + 1], a, below[o].y, above[o].y);
            }
        }
    }
    for (int adder = 0; adder < WARPS; ++adder) {
        if (warp == adder) {
#pragma unroll
            for (int i = 0; i < INS; ++i)
#pragma unroll
                for (int o = 0; o < 2 * OUTS; ++o)
#pragma unroll
                    for (int j = 0; j < 4; ++j) {
                        const int k = 16 * i + 4 * (g >> 1) + (g & 1) + (j & 2);
                        const int n = 16 * (o / 2) + 4 * t + (j & 1) + 2 * (o & 1);
                        float& sum = sums[k * N_SIZE + n];
                        sum = adder ? sum + acc[i][o][j] : acc[i][o][j];
                    }
        }
        __syncthreads();
    }
    float* part = parts.data + (size_t)(blockIdx.x / tiles) * parts.shape[1] * parts.shape[2];
    for (int i = threadIdx.x; i < K_SIZE * N_SIZE; i += 32 * WARPS)
        part[(k0 + i / N_SIZE) * parts.shape[2] + n0 + i % N_SIZE] = sums[i];
}
