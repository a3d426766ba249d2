"""Adam and gradient clipping on the CPU: one thread a slab."""

import warp as wp

from cvkern.kernels.warp.radiance._fixed_point import fraction

from ._adam_step import STEP_ON_CPU

wp.set_module_options({"enable_backward": False})


@wp.func_native(f"""
    #pragma clang fp contract(fast)
    {STEP_ON_CPU}
    float *gs = gradients.data, *ms = mean.data, *vs = square.data, *ws = weights.data;
    float* again = copy.data;
    #pragma clang loop vectorize(assume_safety)
    for (int i = first; i < last; ++i) {{
        const float slope = gs[i] * factor, m0 = ms[i], v0 = vs[i], w0 = ws[i];
        float m1 = m0, v1 = v0, w1 = w0;
        step(slope + decay * w0, m1, v1, w1, learning);
        const bool moves = !sparse || slope != 0.0f;
        gs[i] = 0.0f;
        ms[i] = moves ? m1 : m0;
        vs[i] = moves ? v1 : v0;
        ws[i] = moves ? w1 : w0;
        again[i] = moves ? w1 : w0;
    }}
""")
def move(
    first: int,
    last: int,
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
    copy: wp.array[float],
): ...


@wp.kernel
def adam(
    slab: int,
    first: int,
    last: int,
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
    copy: wp.array[float],  # (N,): the weights again
):
    move(
        first, last, rate[0] / rate[1], 1.0 / rate[2], factor[0], beta1, beta2, epsilon, decay,
        sparse, gradients, mean, square, weights, copy,
    )  # fmt: skip


@wp.kernel
def collect(
    slab: int,
    first: int,
    last: int,
    # outputs
    sums: wp.array[wp.int64],  # (N,): set to 0
    gradients: wp.array[float],  # (N,): added to
):
    for i in range(first, last):
        gradients[i] = gradients[i] + fraction(sums[i])
        sums[i] = wp.int64(0)


@wp.func_native("""
    const long long count = gradients.shape[0], all = parts.shape[0];
    for (int part = first; part < last; ++part) {
        const long long begin = count * part / all, end = count * (part + 1) / all;
        float lanes[16] = {};
        long long i = begin;
        for (; i + 16 <= end; i += 16) {
            const float* g = gradients.data + i;
            #pragma clang loop vectorize(assume_safety)
            for (int lane = 0; lane < 16; ++lane) lanes[lane] += g[lane] * g[lane];
        }
        float sum = 0.0f;
        for (; i < end; ++i) sum += gradients.data[i] * gradients.data[i];
        for (int lane = 0; lane < 16; ++lane) sum += lanes[lane];
        parts.data[part] += sum;
    }
""")
def add_parts(first: int, last: int, gradients: wp.array[float], parts: wp.array[float]): ...


@wp.kernel
def squares(
    slab: int,
    first: int,
    last: int,
    gradients: wp.array[float],  # (N,)
    # outputs
    parts: wp.array[float],  # (P,): added to
):
    add_parts(first, last, gradients, parts)


@wp.kernel
def clip(
    scale: float,
    most: float,
    # outputs
    parts: wp.array[float],  # (P,): set to 0
    factor: wp.array[float],  # (1,)
):
    total = float(0.0)
    for part in range(parts.shape[0]):
        total += parts[part]
        parts[part] = 0.0
    norm = wp.sqrt(total) * scale
    factor[0] = scale
    if norm > most:
        factor[0] = scale * (most / norm)
