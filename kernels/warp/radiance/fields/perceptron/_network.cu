#include "../../_harmonics.h"
#include "_tensor_cores.cu"
#pragma once

// The two perceptrons of INPUTS features, for 16 samples in a warp's registers; the second one is
// present only if COLOR; it has the light of a photograph as an input if LIT. Operands are [columns / 16][4], sums [columns / 8][4].
//
// The result of `mma.m16n8k16`, 16 samples x 8 columns, has the layout of half of its first
// operand: lane 4 g + t has columns 2 t and 2 t + 1 of samples g and g + 8. So the sums of a layer
// become the operand of the next layer without moving. Weights are in shared memory as in global
// memory, except that rows are 16 bytes longer, so that 8 rows are on different banks. `ldmatrix`
// loads 8 x 8 pieces, transposed for a layer, and not transposed for the gradient of its inputs.
struct Network {
    using Cores = TensorCores;
    using Sums = float[4];            // 8 columns
    using Operand = unsigned int[4];  // 16 columns

    // Lengths of rows, and the begin of each layer in `weights` (AT) and in shared memory (IN).
    enum {
        WIDE = 64 + 8,
        NARROW = 16 + 8,
        AT1 = INPUTS * 64,
        AT2 = AT1 + 64 * 16,
        HIDDEN = 2 + LIT,  // inputs of the second perceptron / 16
        AT3 = AT2 + HIDDEN * 16 * 64,
        AT4 = AT3 + 64 * 64,
        IN1 = INPUTS * WIDE,
        IN2 = IN1 + 64 * NARROW,
        IN3 = IN2 + HIDDEN * 16 * WIDE,
        IN4 = IN3 + 64 * WIDE,
        IN5 = IN4 + 64 * NARROW
    };

    // The outputs of all layers, for samples `row` and `row` + 8.
    struct Values {
        unsigned int x[INPUTS / 16][4], first[4][4], hidden[HIDDEN][4], second[4][4], third[4][4];
        float wide[8][4], density[2][4];
    };

    int warp, lane, g, t, rows;
    unsigned short* layers;

    Network(const void* weights, int rows) : rows(rows) {
        __shared__ __align__(16) unsigned short room[COLOR ? IN5 : IN2];
        warp = threadIdx.x >> 5, lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
        layers = room;
        const unsigned short* from = (const unsigned short*)weights;
        copy(from, 0, 0, INPUTS, 64);
        copy(from, IN1, AT1, 64, 16);
        if (COLOR) {
            copy(from, IN2, AT2, HIDDEN * 16, 64);
            copy(from, IN3, AT3, 64, 64);
            copy(from, IN4, AT4, 64, 16);
        }
        __syncthreads();
    }

    void copy(const unsigned short* weights, int in, int at, int depth, int columns) {
        const uint4* from = (const uint4*)(weights + at);
        const int pieces = columns / 8;
        for (int i = threadIdx.x; i < depth * pieces; i += blockDim.x)
            *(uint4*)(layers + in + i / pieces * (columns + 8) + i % pieces * 8) = from[i];
    }

    // sums = x w, of depth and columns in groups of 16 and 8.
    __forceinline__ void multiply(Sums* sums, int columns, const Operand* x, int depth,
                                  const unsigned short* w, int pitch) const {
        const unsigned short* row = w + (lane & 15) * pitch + (lane >> 4) * 8;
#pragma unroll
        for (int n = 0; n < columns; ++n)
#pragma unroll
            for (int i = 0; i < 4; ++i) sums[n][i] = 0.0f;
#pragma unroll
        for (int k = 0; k < depth; ++k)
#pragma unroll
            for (int n = 0; n < columns; n += 2) {
                unsigned int b[4];
                Cores::load_turned(b, row + 16 * k * pitch + 8 * n);
                Cores::mma(sums[n], x[k], b[0], b[1]);
                Cores::mma(sums[n + 1], x[k], b[2], b[3]);
            }
    }

    // Make an operand of sums, in groups of 16 columns.
    static __forceinline__ void operand(Operand* x, int groups, const Sums* sums) {
#pragma unroll
        for (int k = 0; k < groups; ++k)
#pragma unroll
            for (int i = 0; i < 4; ++i) {
                const float* two = sums[2 * k + i / 2] + i % 2 * 2;
                x[k][i] = Cores::pack(two[0], two[1]);
            }
    }

    static __forceinline__ void rectified(Operand* x, int groups, Sums* sums) {
#pragma unroll
        for (int n = 0; n < 2 * groups; ++n)
#pragma unroll
            for (int i = 0; i < 4; ++i) sums[n][i] = sums[n][i] > 0.0f ? sums[n][i] : 0.0f;
        operand(x, groups, sums);
    }

    // Read the features of samples `row` and `row` + 8.
    __forceinline__ void read(Operand* x, const void* features, int row) const {
        const unsigned short* from = (const unsigned short*)features + 2 * t;
#pragma unroll
        for (int k = 0; k < INPUTS / 16; ++k)
#pragma unroll
            for (int i = 0; i < 4; ++i) {
                const int line = row + i % 2 * 8;
                const size_t at = (size_t)line * INPUTS + 16 * k + i / 2 * 8;
                x[k][i] = line < rows ? *(const unsigned int*)(from + at) : 0u;
            }
    }

    // Find this lane's four of the 16 harmonics of the view.
    __forceinline__ void view(unsigned int* to, const float* directions, const int* rays,
                              int row) const {
#pragma unroll
        for (int half = 0; half < 2; ++half) {
            const int line = row + 8 * half;
            to[half] = to[half + 2] = 0u;
            if (line >= rows) continue;
            const float* d = directions + 3 * (size_t)rays[line];
            float h[16];
            Harmonics::write(d[0], d[1], d[2], h);
            auto own = [&](int k) {  // h[k + 2 t], of registers
                return t & 2 ? t & 1 ? h[k + 6] : h[k + 4] : t & 1 ? h[k + 2] : h[k];
            };
            to[half] = Cores::pack(own(0), own(1));
            to[half + 2] = Cores::pack(own(8), own(9));
        }
    }

    // Find this lane's four of the 16 numbers of the photograph's light.
    __forceinline__ void light(unsigned int* to, const float* table, const int* views,
                               const int* of, int row) const {
#pragma unroll
        for (int half = 0; half < 2; ++half) {
            const int line = row + 8 * half;
            to[half] = to[half + 2] = 0u;
            if (line >= rows) continue;
            const float* own = table + 16 * (size_t)views[of[line]] + 2 * t;
            to[half] = Cores::pack(own[0], own[1]);
            to[half + 2] = Cores::pack(own[8], own[9]);
        }
    }

    // From features to the density and 15 more numbers.
    __forceinline__ void density_layers(Values& v, const void* features, int row) const {
        read(v.x, features, row);
        multiply(v.wide, 8, v.x, INPUTS / 16, layers, WIDE);
        rectified(v.first, 4, v.wide);
        multiply(v.density, 2, v.first, 4, layers + IN1, NARROW);
    }

    // From there to the inputs of the last layer; v.hidden has the light, if LIT.
    __forceinline__ void color_layers(Values& v, const float* directions, const int* rays,
                                      int row) const {
        view(v.hidden[1], directions, rays, row);
        operand(v.hidden, 1, v.density);
        multiply(v.wide, 8, v.hidden, HIDDEN, layers + IN2, WIDE);
        rectified(v.second, 4, v.wide);
        multiply(v.wide, 8, v.second, 4, layers + IN3, WIDE);
        rectified(v.third, 4, v.wide);
    }

    // Write densities: see heads.py.
    __forceinline__ void write_sigma(float* sigma, const Values& v, int row) const {
        for (int half = 0; half < 2; ++half)
            if (t == 0 && row + 8 * half < rows)
                sigma[row + 8 * half] = expf(fminf(v.density[0][2 * half], MOST_LOG_DENSITY));
    }
};
