"""Adam and gradient clipping on CUDA: four numbers a thread, in 16-byte loads and stores."""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import BLOCK
from cvkern.kernels.warp.radiance._fixed_point import FRACTION
from cvkern.kernels.warp.radiance._sums_cuda import SUM_OF_BLOCK

from ._adam_step import STEP_ON_CUDA

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)


def threads(count: int) -> int:
    """Return how many threads take four of `count` numbers each, or one of those left over."""
    return count // 4 + count % 4


_ADAM = (
    STEP_ON_CUDA
    + """
    auto move = [&](float slope, float& m, float& v, float& w) {
        const float g = slope * factor;
        if (sparse && g == 0.0f) return;
        step(g + decay * w, m, v, w, learning);
    };
    const int quads = weights.shape[0] / 4;
    if (thread < quads) {
        float4& slope = ((float4*)gradients.data)[thread];
        const float4 g = slope;
        const bool any = g.x != 0.0f || g.y != 0.0f || g.z != 0.0f || g.w != 0.0f;
        if (sparse && !any) return;
        float4 m = ((float4*)mean.data)[thread];
        float4 v = ((float4*)square.data)[thread];
        float4 w = ((float4*)weights.data)[thread];
        move(g.x, m.x, v.x, w.x);
        move(g.y, m.y, v.y, w.y);
        move(g.z, m.z, v.z, w.z);
        move(g.w, m.w, v.w, w.w);
        if (any) slope = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        ((float4*)mean.data)[thread] = m;
        ((float4*)square.data)[thread] = v;
        ((float4*)weights.data)[thread] = w;
        COPY_FOUR
    } else {
        const int i = 3 * quads + thread;
        float w = weights.data[i];
        move(gradients.data[i], mean.data[i], square.data[i], w);
        gradients.data[i] = 0.0f;
        weights.data[i] = w;
        COPY_ONE
    }
"""
)

_COPIES = {
    wp.float32: {
        "COPY_FOUR": "if (copy.data != weights.data) ((float4*)copy.data)[thread] = w;",
        "COPY_ONE": "copy.data[i] = w;",
    },
    wp.float16: {
        "COPY_FOUR": """
        uint2 halves;
        asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(halves.x) : "f"(w.y), "f"(w.x));
        asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(halves.y) : "f"(w.w), "f"(w.z));
        ((uint2*)copy.data)[thread] = halves;""",
        "COPY_ONE": """
        unsigned short half;
        asm("cvt.rn.f16.f32 %0, %1;" : "=h"(half) : "f"(w));
        ((unsigned short*)copy.data)[i] = half;""",
    },
}


@cache
def adam(scalar: Any) -> wp.Kernel:
    """Return the kernel that leaves a copy of the weights in some precision."""
    text = _ADAM
    for name, part in _COPIES[scalar].items():
        text = text.replace(name, part)

    @wp.func_native(text)
    def move(
        thread: int,
        learning: float,
        mend: float,
        factor: float,
        beta1: float,
        beta2: float,
        epsilon: float,
        decay: float,
        sparse: bool,
        gradients: wp.array[float],
        mean: wp.array[float],
        square: wp.array[float],
        weights: wp.array[float],
        copy: wp.array[scalar],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def adam(
        rate: wp.array[float],  # (3,): of learning, and what the two means have to be divided by
        factor: wp.array[float],  # (1,): of the gradients
        beta1: float,
        beta2: float,
        epsilon: float,
        decay: float,
        sparse: bool,
        # outputs
        gradients: wp.array[float],  # (N,): set to 0
        mean: wp.array[float],  # (N,)
        square: wp.array[float],  # (N,)
        weights: wp.array[float],  # (N,)
        copy: wp.array[scalar],  # (N,): the weights again
    ):
        move(
            wp.tid(), rate[0] / rate[1], 1.0 / rate[2], factor[0], beta1, beta2, epsilon, decay,
            sparse, gradients, mean, square, weights, copy,
        )  # fmt: skip

    return adam


@wp.func_native(
    FRACTION
    + """
    const int quads = gradients.shape[0] / 4;
    if (thread < quads) {
        longlong2* four = (longlong2*)sums.data + 2 * (size_t)thread;
        const longlong2 a = four[0], b = four[1];
        if (a.x | a.y | b.x | b.y) {
            four[0] = four[1] = make_longlong2(0, 0);
            float4 g = ((float4*)gradients.data)[thread];
            g.x += fraction(a.x);
            g.y += fraction(a.y);
            g.z += fraction(b.x);
            g.w += fraction(b.y);
            ((float4*)gradients.data)[thread] = g;
        }
    } else {
        const int i = 3 * quads + thread;
        gradients.data[i] += fraction(sums.data[i]);
        sums.data[i] = 0;
    }
"""
)
def collect_some(thread: int, sums: wp.array[wp.int64], gradients: wp.array[float]): ...


@wp.kernel
def collect(
    # outputs
    sums: wp.array[wp.int64],  # (N,): set to 0
    gradients: wp.array[float],  # (N,): added to
):
    collect_some(wp.tid(), sums, gradients)


@wp.func_native(f"""{SUM_OF_BLOCK}
    const int count = gradients.shape[0], quads = count / 4, part = blockIdx.x;
    float sum = 0.0f;
    for (int i = part * {BLOCK} + threadIdx.x; i < quads; i += parts.shape[0] * {BLOCK}) {{
        const float4 g = ((const float4*)gradients.data)[i];
        sum += (g.x * g.x + g.y * g.y) + (g.z * g.z + g.w * g.w);
    }}
    const int left = 4 * quads + threadIdx.x;
    if (part == 0 && left < count) sum += gradients.data[left] * gradients.data[left];
    sum = sum_of_block(sum);
    if (threadIdx.x == 0) parts.data[part] += sum;
""")
def add_block(gradients: wp.array[float], parts: wp.array[float]): ...


@wp.kernel
def squares(
    gradients: wp.array[float],  # (N,)
    # outputs
    parts: wp.array[float],  # (P,): added to, by a block each
):
    add_block(gradients, parts)


@wp.func_native(f"""{SUM_OF_BLOCK}
    float sum = 0.0f;
    for (int part = threadIdx.x; part < parts.shape[0]; part += {BLOCK}) {{
        sum += parts.data[part];
        parts.data[part] = 0.0f;
    }}
    const float norm = sqrtf(sum_of_block(sum)) * scale;
    if (threadIdx.x == 0) factor.data[0] = norm > most ? scale * (most / norm) : scale;
""")
def shrink(scale: float, most: float, parts: wp.array[float], factor: wp.array[float]): ...


@wp.kernel
def clip(
    scale: float,
    most: float,
    # outputs
    parts: wp.array[float],  # (P,): set to 0
    factor: wp.array[float],  # (1,)
):
    shrink(scale, most, parts, factor)
