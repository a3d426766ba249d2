"""The perceptrons of a hash field on CUDA: all layers of 16 samples in a warp's registers.

What `mma.m16n8k16` gives, 16 samples x 8 columns, is half of what it takes as its first operand:
lane 4 g + t has columns 2 t and 2 t + 1 of samples g and g + 8 of it. So the sums of a layer become
the operand of the next one where they are. Weights are in shared memory as in global memory, but
for rows 16 bytes longer, which puts 8 of them on different banks: `ldmatrix` takes 8 x 8 pieces of
them, turned for a layer, and as they are for the gradient of its inputs.

The gradient of a layer's weights is a sum over samples. A block lays 64 of them side by side in
shared memory, inputs and gradients of outputs, and each of its four warps adds up a part of each
layer's gradient in registers for as long as there are samples: 16 columns of layers that have 64,
16 rows of layers that have 16. No order depends on timing, so a gradient is the same in each run.
"""

from functools import cache

import warp as wp

wp.set_module_options({"enable_backward": False})

OPTIONS = {"enable_backward": False}
FORWARD = 256  # threads of a block
BACKWARD = 128
SUM = 256

# What a warp does together, and how its lanes round.
INSTRUCTIONS = """
    // c += a b for 16 samples x 16 and 16 x 8
    auto mma = [](float* c, const unsigned int* a, unsigned int b0, unsigned int b1) {
        asm volatile(
            "mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 "
            "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
            : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
            : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
    };
    // Four 8 x 8 pieces; lane 8 i + j points at row j of piece i.
    auto load = [](unsigned int* p, const unsigned short* row) {
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0, %1, %2, %3}, [%4];"
            : "=r"(p[0]), "=r"(p[1]), "=r"(p[2]), "=r"(p[3])
            : "r"((unsigned int)__cvta_generic_to_shared(row)) : "memory");
    };
    auto load_turned = [](unsigned int* p, const unsigned short* row) {
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0, %1, %2, %3}, [%4];"
            : "=r"(p[0]), "=r"(p[1]), "=r"(p[2]), "=r"(p[3])
            : "r"((unsigned int)__cvta_generic_to_shared(row)) : "memory");
    };
    auto pack = [](float low, float high) {  // within what float16 can hold
        unsigned int both;
        asm("cvt.rn.satfinite.f16x2.f32 %0, %1, %2;" : "=r"(both) : "f"(high), "f"(low));
        return both;
    };
"""

# Where each layer is in `weights`, and in shared memory: AT and IN; the first two make a density.
_LAYERS = """
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
_PRODUCTS = f"""
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

# The harmonics of radiance_encode.py: this lane's four of the 16.
_VIEW = """
    auto view = [&](unsigned int* x, int row) {
        #pragma unroll
        for (int half = 0; half < 2; ++half) {
            const int line = row + 8 * half;
            x[half] = x[half + 2] = 0u;
            if (line >= rows) continue;
            const float* d = directions.data + 3 * (size_t)rays.data[line];
            const float x1 = d[0], y1 = d[1], z1 = d[2];
            const float xx = x1 * x1, yy = y1 * y1, zz = z1 * z1;
            const float h[16] = {
                0.28209479177387814f, -0.4886025119029199f * y1,
                0.4886025119029199f * z1, -0.4886025119029199f * x1,
                1.0925484305920792f * x1 * y1, -1.0925484305920792f * y1 * z1,
                0.31539156525252005f * (3.0f * zz - 1.0f), -1.0925484305920792f * x1 * z1,
                0.5462742152960396f * (xx - yy), -0.5900435899266435f * y1 * (3.0f * xx - yy),
                2.890611442640554f * x1 * y1 * z1, -0.4570457994644658f * y1 * (5.0f * zz - 1.0f),
                0.3731763325901154f * z1 * (5.0f * zz - 3.0f),
                -0.4570457994644658f * x1 * (5.0f * zz - 1.0f),
                1.445305721320277f * z1 * (xx - yy), -0.5900435899266435f * x1 * (xx - 3.0f * yy)};
            auto own = [&](int k) {  // h[k + 2 t], of registers
                return t & 2 ? t & 1 ? h[k + 6] : h[k + 4] : t & 1 ? h[k + 2] : h[k];
            };
            x[half] = pack(own(0), own(1));
            x[half + 2] = pack(own(8), own(9));
        }
    };
"""

# Samples `row` and `row` + 8 from their features to the last layer's inputs; all values are kept.
_DENSITY = """
        unsigned int x[INPUTS / 16][4], first[4][4], hidden[2][4];
        float wide[8][4], density[2][4];
        read(x, row);
        multiply(wide, x, layers, WIDE);
        rectified(first, wide);
        multiply(density, first, layers + IN1, NARROW);
"""
_COLOR = """
        unsigned int second[4][4], third[4][4];
        view(hidden[1], row);
        operand(hidden, density);
        multiply(wide, hidden, layers + IN2, WIDE);
        rectified(second, wide);
        multiply(wide, second, layers + IN3, WIDE);
        rectified(third, wide);
"""

# What forward passes write: see radiance_heads.py.
_WRITE_SIGMA = """
        for (int half = 0; half < 2; ++half)
            if (t == 0 && row + 8 * half < rows)
                sigma.data[row + 8 * half] = expf(fminf(density[0][2 * half], 11.0f));
"""
_WRITE_RGB = """
        float raw[2][4];
        multiply(raw, third, layers + IN4, NARROW);
        for (int half = 0; half < 2; ++half)
            for (int j = 0; j < 2; ++j)
                if (2 * t + j < 3 && row + 8 * half < rows)
                    rgb.data[3 * (size_t)(row + 8 * half) + 2 * t + j] =
                        1.0f / (1.0f + expf(-raw[0][2 * half + j]));
"""

_FORWARD = f"""{_LAYERS}{_PRODUCTS}BEFORE
    const int stride = gridDim.x * {FORWARD // 2};
    for (int row = (blockIdx.x * {FORWARD // 32} + warp) * 16 + g; row - g < rows; row += stride) {{
        {_DENSITY}{_WRITE_SIGMA}AFTER
    }}
"""

_BACKWARD = f"""{_LAYERS}{_PRODUCTS}{_VIEW}
    __shared__ __align__(16) unsigned short inputs[64 * WIDE], outputs[64 * WIDE];
    auto multiply_back = [&](auto& sums, const auto& dy, const unsigned short* w, int pitch) {{
        // dy w^T
        constexpr int depth = sizeof(dy) / sizeof(dy[0]), columns = sizeof(sums) / sizeof(sums[0]);
        const unsigned short* row = w + (lane % 8 + lane / 16 * 8) * pitch + lane / 8 % 2 * 8;
        #pragma unroll
        for (int n = 0; n < columns; ++n)
            for (int i = 0; i < 4; ++i) sums[n][i] = 0.0f;
        #pragma unroll
        for (int k = 0; k < depth; ++k)
            #pragma unroll
            for (int n = 0; n < columns; n += 2) {{
                unsigned int b[4];
                load(b, row + 8 * n * pitch + 16 * k);
                mma(sums[n], dy[k], b[0], b[1]);
                mma(sums[n + 1], dy[k], b[2], b[3]);
            }}
    }};
    auto gated = [&](auto& dx, const auto& sums, const auto& y) {{  // 0 where a rectifier gave 0
        operand(dx, sums);
        constexpr int groups = sizeof(y) / sizeof(y[0]);
        #pragma unroll
        for (int k = 0; k < groups; ++k)
            #pragma unroll
            for (int i = 0; i < 4; ++i)  // no half of y is negative: those above 0 carry to bit 15
                dx[k][i] &= ((y[k][i] + 0x7fff7fffu) >> 15 & 0x00010001u) * 0xffffu;
    }};
    auto lay = [&](unsigned short* to, const auto& x) {{
        constexpr int groups = sizeof(x) / sizeof(x[0]);
        unsigned short* own = to + (16 * warp + g) * WIDE + 2 * t;
        #pragma unroll
        for (int k = 0; k < groups; ++k)
            #pragma unroll
            for (int i = 0; i < 4; ++i)
                *(unsigned int*)(own + i % 2 * 8 * WIDE + 16 * k + i / 2 * 8) = x[k][i];
    }};
    auto share = [&](const auto& x, const auto& dy) {{
        __syncthreads();  // all have used what was there
        lay(inputs, x);
        lay(outputs, dy);
    }};
    auto add = [&](auto& dw, int depth, int column) {{  // 64 samples' x^T dy, from there on
        __syncthreads();
        constexpr int tiles = sizeof(dw) / sizeof(dw[0]);
        const unsigned short* x = inputs + (lane % 8 + lane / 16 * 8) * WIDE + lane / 8 % 2 * 8;
        const unsigned short* dy = outputs + (lane & 15) * WIDE + (lane >> 4) * 8;
        #pragma unroll
        for (int s = 0; s < 64; s += 16) {{
            unsigned int b[4];
            load_turned(b, dy + s * WIDE + column);
            #pragma unroll
            for (int k = 0; k < tiles; ++k) {{
                unsigned int a[4];
                load_turned(a, x + s * WIDE + depth + 16 * k);
                mma(dw[k][0], a, b[0], b[1]);
                mma(dw[k][1], a, b[2], b[3]);
            }}
        }}
    }};
    float dw0[INPUTS / 16][2][4] = {{}}, dw1[1][2][4] = {{}}, dw2[2][2][4] = {{}};
    float dw3[4][2][4] = {{}}, dw4[1][2][4] = {{}};
    for (int begin = blockIdx.x * 64; begin < rows; begin += gridDim.x * 64) {{
        const int row = begin + 16 * warp + g;
        // With s = exp(h), ds/dh = s; with c = 1 / (1 + exp(-r)), dc/dr = c (1 - c).
        unsigned int d_raw[1][4] = {{}}, d_third[4][4], d_second[4][4];
        unsigned int d_hidden[1][4], d_first[4][4];
        float up[2] = {{}};
        #pragma unroll
        for (int half = 0; half < 2; ++half) {{
            const int line = row + 8 * half;
            if (line >= rows) continue;
            float d[2] = {{}};
            for (int j = 0; j < 2; ++j)
                if (2 * t + j < 3) {{
                    const size_t at = 3 * (size_t)line + 2 * t + j;
                    d[j] = d_rgb.data[at] * rgb.data[at] * (1.0f - rgb.data[at]);
                }}
            d_raw[0][half] = pack(d[0], d[1]);
            if (t == 0)  // float16 ends at 65504
                up[half] =
                    fminf(fmaxf(d_sigma.data[line] * sigma.data[line], -30000.0f), 30000.0f);
        }}
        {_DENSITY}{_COLOR}
        share(third, d_raw);
        multiply_back(wide, d_raw, layers + IN4, NARROW);
        gated(d_third, wide, third);
        add(dw4, 16 * warp, 0);
        share(second, d_third);
        multiply_back(wide, d_third, layers + IN3, WIDE);
        gated(d_second, wide, second);
        add(dw3, 0, 16 * warp);
        share(hidden, d_second);
        multiply_back(density, d_second, layers + IN2, WIDE);  // the view needs no gradient
        density[0][0] += up[0];
        density[0][2] += up[1];
        operand(d_hidden, density);
        add(dw2, 0, 16 * warp);
        share(first, d_hidden);
        multiply_back(wide, d_hidden, layers + IN1, NARROW);
        gated(d_first, wide, first);
        add(dw1, 16 * warp, 0);
        share(x, d_first);
        float back[INPUTS / 8][4];
        multiply_back(back, d_first, layers, WIDE);
        operand(x, back);
        #pragma unroll
        for (int k = 0; k < INPUTS / 16; ++k)
            #pragma unroll
            for (int i = 0; i < 4; ++i) {{
                const int line = row + i % 2 * 8;
                const size_t at = (size_t)line * INPUTS + 16 * k + i / 2 * 8 + 2 * t;
                if (line < rows) *(unsigned int*)((unsigned short*)d_features.data + at) = x[k][i];
            }}
        add(dw0, 0, 16 * warp);
    }}
    auto write = [&](const auto& dw, int at, int columns, int depth, int column) {{
        constexpr int tiles = sizeof(dw) / sizeof(dw[0]);
        float* own = parts.data + (size_t)blockIdx.x * parts.shape[1] + at;
        #pragma unroll
        for (int k = 0; k < tiles; ++k)
            #pragma unroll
            for (int i = 0; i < 8; ++i) {{
                const int row = depth + 16 * k + g + i / 2 % 2 * 8;
                own[row * columns + column + i / 4 * 8 + 2 * t + i % 2] = dw[k][i / 4][i % 4];
            }}
    }};
    write(dw0, 0, 64, 0, 16 * warp);
    write(dw1, AT1, 16, 16 * warp, 0);
    write(dw2, AT2, 64, 0, 16 * warp);
    write(dw3, AT3, 64, 0, 16 * warp);
    write(dw4, AT4, 16, 16 * warp, 0);
"""

# A warp adds up an eighth of the rows for 32 columns.
SUM_TEXT = """
    __shared__ float sums[8][32];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, column = blockIdx.x * 32 + lane;
    const int rows = parts.shape[0], last = rows * (warp + 1) / 8;
    float sum = 0.0f;
    #pragma unroll 8
    for (int row = rows * warp / 8; row < last; ++row)
        sum += parts.data[(size_t)row * parts.shape[1] + column];
    sums[warp][lane] = sum;
    __syncthreads();
    if (warp) return;
    for (int i = 1; i < 8; ++i) sum += sums[i][lane];
    d_weights.data[column] += sum;
"""


def forward_text(inputs: int, color: bool) -> str:
    """Return the code of a forward pass, or of its half up to the density."""
    text = _FORWARD.replace("BEFORE", _VIEW * color).replace("AFTER", (_COLOR + _WRITE_RGB) * color)
    return text.replace("INPUTS", str(inputs)).replace("COLOR", "true" if color else "false")


def backward_text(inputs: int) -> str:
    """Return the code of the backward pass."""
    return _BACKWARD.replace("INPUTS", str(inputs)).replace("COLOR", "true")


@cache
def forward(inputs: int) -> wp.Kernel:
    """Return the kernel of densities and colours from so many features."""

    @wp.func_native(forward_text(inputs, True))
    def pass_on(
        features: wp.array2d[wp.float16],
        directions: wp.array2d[float],
        rays: wp.array[int],
        total: wp.array[int],
        weights: wp.array[wp.float16],
        sigma: wp.array[float],
        rgb: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(FORWARD, 2))
    def forward(
        features: wp.array2d[wp.float16],  # (M, inputs)
        directions: wp.array2d[float],  # (R, 3)
        rays: wp.array[int],  # (M,)
        total: wp.array[int],  # (1,)
        weights: wp.array[wp.float16],  # (W,)
        # outputs
        sigma: wp.array[float],  # (M,)
        rgb: wp.array2d[float],  # (M, 3)
    ):
        pass_on(features, directions, rays, total, weights, sigma, rgb)

    return forward


@cache
def density(inputs: int) -> wp.Kernel:
    """Return the kernel of densities alone."""

    @wp.func_native(forward_text(inputs, False))
    def pass_on(
        features: wp.array2d[wp.float16],
        total: wp.array[int],
        weights: wp.array[wp.float16],
        sigma: wp.array[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(FORWARD, 2))
    def density(
        features: wp.array2d[wp.float16],  # (M, inputs)
        total: wp.array[int],  # (1,)
        weights: wp.array[wp.float16],  # (W,)
        # outputs
        sigma: wp.array[float],  # (M,)
    ):
        pass_on(features, total, weights, sigma)

    return density


@cache
def backward(inputs: int) -> wp.Kernel:
    """Return the kernel of all gradients, those of weights in a part for each block."""

    @wp.func_native(backward_text(inputs))
    def pass_back(
        d_sigma: wp.array[float],
        d_rgb: wp.array2d[float],
        features: wp.array2d[wp.float16],
        directions: wp.array2d[float],
        rays: wp.array[int],
        total: wp.array[int],
        weights: wp.array[wp.float16],
        sigma: wp.array[float],
        rgb: wp.array2d[float],
        d_features: wp.array2d[wp.float16],
        parts: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(BACKWARD, 2))
    def backward(
        d_sigma: wp.array[float],  # (M,)
        d_rgb: wp.array2d[float],  # (M, 3)
        features: wp.array2d[wp.float16],  # (M, inputs)
        directions: wp.array2d[float],  # (R, 3)
        rays: wp.array[int],  # (M,)
        total: wp.array[int],  # (1,)
        weights: wp.array[wp.float16],  # (W,)
        sigma: wp.array[float],  # (M,)
        rgb: wp.array2d[float],  # (M, 3)
        # outputs
        d_features: wp.array2d[wp.float16],  # (M, inputs)
        parts: wp.array2d[float],  # (blocks, W)
    ):
        pass_back(
            d_sigma,
            d_rgb,
            features,
            directions,
            rays,
            total,
            weights,
            sigma,
            rgb,
            d_features,
            parts,
        )

    return backward


@wp.func_native(SUM_TEXT)
def add_up(parts: wp.array2d[float], d_weights: wp.array[float]): ...


@wp.kernel
def gather(
    parts: wp.array2d[float],  # (blocks, W)
    # outputs
    d_weights: wp.array[float],  # (W,): added to
):
    add_up(parts, d_weights)
