"""What the CUDA kernels of a hash field's perceptrons have in common: pieces of their native code.

What `mma.m16n8k16` gives, 16 samples x 8 columns, is half of what it takes as its first operand:
lane 4 g + t has columns 2 t and 2 t + 1 of samples g and g + 8 of it. So the sums of a layer become
the operand of the next one where they are. Weights are in shared memory as in global memory, but
for rows 16 bytes longer, which puts 8 of them on different banks: `ldmatrix` takes 8 x 8 pieces of
them, turned for a layer, and as they are for the gradient of its inputs.
"""

from cvkern.kernels.warp.radiance._harmonics import HARMONICS

from ._tensor_cores_cuda import INSTRUCTIONS

# Where each layer is in `weights`, and in shared memory: AT and IN. There are INPUTS features; the
# first two layers make a density, and only if COLOR the others are there.
LAYERS = """
    constexpr int WIDE = 64 + 8, NARROW = 16 + 8;
    constexpr int AT1 = INPUTS * 64, AT2 = AT1 + 64 * 16, AT3 = AT2 + 32 * 64, AT4 = AT3 + 64 * 64;
    constexpr int IN1 = INPUTS * WIDE, IN2 = IN1 + 64 * NARROW, IN3 = IN2 + 32 * WIDE;
    constexpr int IN4 = IN3 + 64 * WIDE, IN5 = IN4 + 64 * NARROW;
    __shared__ __align__(16) unsigned short layers[COLOR ? IN5 : IN2];
    auto copy = [&](int in, int at, int depth, int columns) {
        const uint4* from = (const uint4*)((const unsigned short*)weights.data + at);
        const int pieces = columns / 8;
        for (int i = threadIdx.x; i < depth * pieces; i += blockDim.x)
            *(uint4*)(layers + in + i / pieces * (columns + 8) + i % pieces * 8) = from[i];
    };
    copy(0, 0, INPUTS, 64);
    copy(IN1, AT1, 64, 16);
    if (COLOR) {
        copy(IN2, AT2, 32, 64);
        copy(IN3, AT3, 64, 64);
        copy(IN4, AT4, 64, 16);
    }
    __syncthreads();
"""

# Operands are [columns / 16][4], sums [columns / 8][4].
PRODUCTS = f"""
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    const int rows = total.data[0];
    {INSTRUCTIONS}
    auto multiply = [&](auto& sums, const auto& x, const unsigned short* w, int pitch) {{  // x w
        constexpr int depth = sizeof(x) / sizeof(x[0]), columns = sizeof(sums) / sizeof(sums[0]);
        const unsigned short* row = w + (lane & 15) * pitch + (lane >> 4) * 8;
        #pragma unroll
        for (int n = 0; n < columns; ++n)
            for (int i = 0; i < 4; ++i) sums[n][i] = 0.0f;
        #pragma unroll
        for (int k = 0; k < depth; ++k)
            #pragma unroll
            for (int n = 0; n < columns; n += 2) {{
                unsigned int b[4];
                load_turned(b, row + 16 * k * pitch + 8 * n);
                mma(sums[n], x[k], b[0], b[1]);
                mma(sums[n + 1], x[k], b[2], b[3]);
            }}
    }};
    auto operand = [&](auto& x, const auto& sums) {{
        constexpr int groups = sizeof(sums) / sizeof(sums[0]) / 2;
        #pragma unroll
        for (int k = 0; k < groups; ++k)
            #pragma unroll
            for (int i = 0; i < 4; ++i) {{
                const float* two = sums[2 * k + i / 2] + i % 2 * 2;
                x[k][i] = pack(two[0], two[1]);
            }}
    }};
    auto rectified = [&](auto& x, auto& sums) {{
        #pragma unroll
        for (auto& piece : sums)
            #pragma unroll
            for (auto& value : piece) value = value > 0.0f ? value : 0.0f;
        operand(x, sums);
    }};
    auto read = [&](auto& x, int row) {{  // the features of samples `row` and `row` + 8
        const unsigned short* from = (const unsigned short*)features.data + 2 * t;
        #pragma unroll
        for (int k = 0; k < INPUTS / 16; ++k)
            #pragma unroll
            for (int i = 0; i < 4; ++i) {{
                const int line = row + i % 2 * 8;
                const size_t at = (size_t)line * INPUTS + 16 * k + i / 2 * 8;
                x[k][i] = line < rows ? *(const unsigned int*)(from + at) : 0u;
            }}
    }};
"""

# The harmonics of the view: this lane's four of the 16.
VIEW = f"""
    auto view = [&](unsigned int* to, int row) {{
        #pragma unroll
        for (int half = 0; half < 2; ++half) {{
            const int line = row + 8 * half;
            to[half] = to[half + 2] = 0u;
            if (line >= rows) continue;
            const float* d = directions.data + 3 * (size_t)rays.data[line];
            const float x = d[0], y = d[1], z = d[2];
            const float h[16] = {{{", ".join(HARMONICS)}}};
            auto own = [&](int k) {{  // h[k + 2 t], of registers
                return t & 2 ? t & 1 ? h[k + 6] : h[k + 4] : t & 1 ? h[k + 2] : h[k];
            }};
            to[half] = pack(own(0), own(1));
            to[half + 2] = pack(own(8), own(9));
        }}
    }};
"""

# Samples `row` and `row` + 8 from their features to the last layer's inputs; all values are kept.
DENSITY_LAYERS = """
        unsigned int x[INPUTS / 16][4], first[4][4], hidden[2][4];
        float wide[8][4], density[2][4];
        read(x, row);
        multiply(wide, x, layers, WIDE);
        rectified(first, wide);
        multiply(density, first, layers + IN1, NARROW);
"""
COLOR_LAYERS = """
        unsigned int second[4][4], third[4][4];
        view(hidden[1], row);
        operand(hidden, density);
        multiply(wide, hidden, layers + IN2, WIDE);
        rectified(second, wide);
        multiply(wide, second, layers + IN3, WIDE);
        rectified(third, wide);
"""
