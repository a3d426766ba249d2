#include "_network.cu"
#pragma once

// The backward pass of a Network. Gradients of weights are sums over 64 samples: the four warps of
// a block store their inputs and gradients of outputs side by side in shared memory.
struct NetworkBack {
    using Cores = TensorCores;
    using Sums = Network::Sums;
    using Operand = Network::Operand;
    using Pair = Sums[2];

    const Network& net;
    unsigned short *inputs, *outputs;

    NetworkBack(const Network& net) : net(net) {
        __shared__ __align__(16) unsigned short room[2][64 * Network::WIDE];
        inputs = room[0];
        outputs = room[1];
    }

    // sums = dy w^T, of depth and columns in groups of 16 and 8.
    __forceinline__ void multiply(Sums* sums, int columns, const Operand* dy, int depth,
                                  const unsigned short* w, int pitch) const {
        const int lane = net.lane;
        const unsigned short* row = w + (lane % 8 + lane / 16 * 8) * pitch + lane / 8 % 2 * 8;
#pragma unroll
        for (int n = 0; n < columns; ++n)
#pragma unroll
            for (int i = 0; i < 4; ++i) sums[n][i] = 0.0f;
#pragma unroll
        for (int k = 0; k < depth; ++k)
#pragma unroll
            for (int n = 0; n < columns; n += 2) {
                unsigned int b[4];
                Cores::load(b, row + 8 * n * pitch + 16 * k);
                Cores::mma(sums[n], dy[k], b[0], b[1]);
                Cores::mma(sums[n + 1], dy[k], b[2], b[3]);
            }
    }

    // Convert sums to an operand that is 0 where the rectifier's output y is 0. No half of y is
    // negative, so an addition sets bit 15 of those above 0.
    static __forceinline__ void gated(Operand* dx, int groups, const Sums* sums, const Operand* y) {
        Network::operand(dx, groups, sums);
#pragma unroll
        for (int k = 0; k < groups; ++k)
#pragma unroll
            for (int i = 0; i < 4; ++i)
                dx[k][i] &= ((y[k][i] + 0x7fff7fffu) >> 15 & 0x00010001u) * 0xffffu;
    }

    // Store this warp's 16 of the 64 samples.
    __forceinline__ void lay(unsigned short* to, const Operand* x, int groups) const {
        unsigned short* own = to + (16 * net.warp + net.g) * Network::WIDE + 2 * net.t;
#pragma unroll
        for (int k = 0; k < groups; ++k)
#pragma unroll
            for (int i = 0; i < 4; ++i)
                *(unsigned int*)(own + i % 2 * 8 * Network::WIDE + 16 * k + i / 2 * 8) = x[k][i];
    }

    // Share inputs and gradients of outputs with the other warps.
    __forceinline__ void share(const Operand* x, int ins, const Operand* dy, int outs) const {
        __syncthreads();  // all warps have read the previous samples
        lay(inputs, x, ins);
        lay(outputs, dy, outs);
    }

    // Add x^T dy of the shared samples, beginning at the given column.
    __forceinline__ void add(Pair* dw, int tiles, int depth, int column) const {
        __syncthreads();
        const int lane = net.lane, pitch = Network::WIDE;
        const unsigned short* x = inputs + (lane % 8 + lane / 16 * 8) * pitch + lane / 8 % 2 * 8;
        const unsigned short* dy = outputs + (lane & 15) * pitch + (lane >> 4) * 8;
#pragma unroll
        for (int s = 0; s < 64; s += 16) {
            unsigned int b[4];
            Cores::load_turned(b, dy + s * pitch + column);
#pragma unroll
            for (int k = 0; k < tiles; ++k) {
                unsigned int a[4];
                Cores::load_turned(a, x + s * pitch + depth + 16 * k);
                Cores::mma(dw[k][0], a, b[0], b[1]);
                Cores::mma(dw[k][1], a, b[2], b[3]);
            }
        }
    }

    // Write this warp's part of a layer's gradient.
    __forceinline__ void write(float* part, const Pair* dw, int tiles, int columns, int depth,
                               int column) const {
#pragma unroll
        for (int k = 0; k < tiles; ++k)
#pragma unroll
            for (int i = 0; i < 8; ++i) {
                const int row = depth + 16 * k + net.g + i / 2 % 2 * 8;
                part[row * columns + column + i / 4 * 8 + 2 * net.t + i % 2] = dw[k][i / 4][i % 4];
            }
    }
};
