"""The perceptrons of a hash field on CUDA: all layers of 16 samples in a warp's registers.

The gradient of a layer's weights is a sum over samples. A block lays 64 of them side by side in
shared memory, inputs and gradients of outputs, and each of its four warps adds up a part of each
layer's gradient in registers for as long as there are samples: 16 columns of layers that have 64,
16 rows of layers that have 16. No order depends on timing, so a gradient is the same in each run.
"""

from functools import cache

import warp as wp

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY, MOST_LOG_DENSITY_GRADIENT

from ._products_cuda import COLOR_LAYERS, DENSITY_LAYERS, LAYERS, PRODUCTS, VIEW

OPTIONS = {"enable_backward": False}
FORWARD = 256  # threads of a block
BACKWARD = 128

# What forward passes write: see heads.py.
_WRITE_SIGMA = f"""
        for (int half = 0; half < 2; ++half)
            if (t == 0 && row + 8 * half < rows)
                sigma.data[row + 8 * half] =
                    expf(fminf(density[0][2 * half], {MOST_LOG_DENSITY}f));
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

# BEFORE and AFTER make the colours, where they are wanted.
_FORWARD = f"""{LAYERS}{PRODUCTS}BEFORE
    const int stride = gridDim.x * {FORWARD // 2};
    for (int row = (blockIdx.x * {FORWARD // 32} + warp) * 16 + g; row - g < rows; row += stride) {{
        {DENSITY_LAYERS}{_WRITE_SIGMA}AFTER
    }}
"""

_BACKWARD = f"""{LAYERS}{PRODUCTS}{VIEW}
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
    auto lay = [&](unsigned short* to, const auto& x) {{  // this warp's 16 of the 64 samples
        constexpr int groups = sizeof(x) / sizeof(x[0]);
        unsigned short* own = to + (16 * warp + g) * WIDE + 2 * t;
        #pragma unroll
        for (int k = 0; k < groups; ++k)
            #pragma unroll
            for (int i = 0; i < 4; ++i)
                *(unsigned int*)(own + i % 2 * 8 * WIDE + 16 * k + i / 2 * 8) = x[k][i];
    }};
    auto share = [&](const auto& x, const auto& dy) {{  // with the other warps
        __syncthreads();  // all have used what was there
        lay(inputs, x);
        lay(outputs, dy);
    }};
    auto add = [&](auto& dw, int depth, int column) {{  // what they share: x^T dy, from there on
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
    const float most_up = {MOST_LOG_DENSITY_GRADIENT}f;
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
            if (t == 0) {{
                const float d = d_sigma.data[line] * sigma.data[line];
                up[half] = fabsf(d) > most_up ? copysignf(most_up, d) : d;  // a NaN stays
            }}
        }}
        {DENSITY_LAYERS}{COLOR_LAYERS}
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


def forward_text(inputs: int, color: bool) -> str:
    """Return the code of a forward pass, or of its half up to the density."""
    text = _FORWARD.replace("BEFORE", VIEW * color).replace(
        "AFTER", (COLOR_LAYERS + _WRITE_RGB) * color
    )
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
            d_sigma, d_rgb, features, directions, rays, total, weights, sigma, rgb, d_features,
            parts,
        )  # fmt: skip

    return backward
