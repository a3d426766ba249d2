"""Layers of a perceptron on the CPU, in float32: one thread a slab of samples.

Each loop keeps LANES sums in vector registers, and reads the other operand row by row.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

LANES = 64  # sums at a time: rows of weights are padded to a multiple
ROWS = 16  # samples after which sums of a weight gradient are written


def _sized(text: str) -> str:
    return text.replace("LANES", str(LANES)).replace("ROWS", str(ROWS))


@wp.func_native(
    _sized("""
    // For LANES columns at a time: sum over k of src[row, k] w[k, n].
    #pragma clang fp contract(fast)
    const int rows = total.data[0] < last ? total.data[0] : last;
    const int pitch = w.shape[1], pitch_in = src.shape[1], pitch_out = dst.shape[1];
    for (int row = first; row < rows; ++row) {
        const float* x = src.data + (size_t)row * pitch_in + column_in;
        float* to = dst.data + (size_t)row * pitch_out + column_out;
        const float* gate = gates.data + (size_t)row * gates.shape[1];
        for (int n0 = 0; n0 < columns; n0 += LANES) {
            float sums[LANES];
            #pragma clang loop vectorize(assume_safety)
            for (int n = 0; n < LANES; ++n) sums[n] = 0.0f;
            for (int k = 0; k < depth; ++k) {
                const float* weights = w.data + (size_t)k * pitch + n0;
                const float value = x[k];
                #pragma clang loop vectorize(assume_safety) interleave(enable)
                for (int n = 0; n < LANES; ++n) sums[n] += value * weights[n];
            }
            const int count = columns - n0 < LANES ? columns - n0 : LANES;
            if (relu)
                for (int n = 0; n < LANES; ++n) sums[n] = sums[n] > 0.0f ? sums[n] : 0.0f;
            if (gated)
                for (int n = 0; n < count; ++n) sums[n] = gate[n0 + n] > 0.0f ? sums[n] : 0.0f;
            for (int n = 0; n < count; ++n) to[n0 + n] = sums[n];
        }
    }
""")
)
def multiply(
    first: int,
    last: int,
    src: wp.array2d[float],
    w: wp.array2d[float],
    gates: wp.array2d[float],
    total: wp.array[int],
    depth: int,
    columns: int,
    column_in: int,
    column_out: int,
    relu: bool,
    gated: bool,
    dst: wp.array2d[float],
): ...


@wp.kernel
def product(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],  # (M, >= depth)
    w: wp.array2d[float],  # (depth, columns padded to a multiple of LANES)
    gates: wp.array2d[float],  # (M, columns)
    total: wp.array[int],  # (1,)
    depth: int,
    columns: int,
    column_in: int,
    column_out: int,
    relu: bool,
    gated: bool,
    # outputs
    dst: wp.array2d[float],  # (M, >= columns)
):
    multiply(
        first, last, src, w, gates, total, depth, columns, column_in, column_out, relu, gated, dst
    )


@wp.func_native(
    _sized("""
    // For ROWS samples at a time: sum over them of src[row, k] dy[row, n].
    #pragma clang fp contract(fast)
    const int rows = total.data[0] < last ? total.data[0] : last;
    const int depth = parts.shape[1], padded = parts.shape[2];
    const int pitch = dy.shape[1], pitch_in = src.shape[1];
    float* own = parts.data + (size_t)slab * depth * padded;
    for (int i = 0; i < depth * padded; ++i) own[i] = 0.0f;
    for (int begin = first; begin < rows; begin += ROWS) {
        const int count = rows - begin < ROWS ? rows - begin : ROWS;
        for (int n0 = 0; n0 < columns; n0 += LANES) {
            float ys[ROWS * LANES];
            const int wide = columns - n0 < LANES ? columns - n0 : LANES;
            const float* from = dy.data + (size_t)begin * pitch + column + n0;
            for (int s = 0; s < count; ++s)
                for (int n = 0; n < LANES; ++n)
                    ys[LANES * s + n] = n < wide ? from[(size_t)s * pitch + n] : 0.0f;
            for (int k = 0; k < depth; ++k) {
                float* to = own + (size_t)k * padded + n0;
                float sums[LANES];
                #pragma clang loop vectorize(assume_safety)
                for (int n = 0; n < LANES; ++n) sums[n] = to[n];
                for (int s = 0; s < count; ++s) {
                    const float value = src.data[(size_t)(begin + s) * pitch_in + k];
                    #pragma clang loop vectorize(assume_safety)
                    for (int n = 0; n < LANES; ++n) sums[n] += value * ys[LANES * s + n];
                }
                #pragma clang loop vectorize(assume_safety)
                for (int n = 0; n < LANES; ++n) to[n] = sums[n];
            }
        }
    }
""")
)
def accumulate(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],
    src: wp.array2d[float],
    total: wp.array[int],
    column: int,
    columns: int,
    parts: wp.array3d[float],
): ...


@wp.kernel
def outer(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (M, >= columns)
    src: wp.array2d[float],  # (M, >= K)
    total: wp.array[int],  # (1,)
    column: int,
    columns: int,
    # outputs
    parts: wp.array3d[float],  # (slabs, K, N padded to a multiple of LANES)
):
    accumulate(slab, first, last, dy, src, total, column, columns, parts)


@wp.kernel
def gather(
    parts: wp.array3d[float],  # (slabs, K, N padded to a multiple of LANES)
    # outputs
    dw: wp.array2d[float],  # (K, N): added to
):
    k = wp.tid()
    for n in range(dw.shape[1]):
        for slab in range(parts.shape[0]):
            dw[k, n] = dw[k, n] + parts[slab, k, n]


@wp.kernel
def pad(
    w: wp.array2d[float],  # (K, N)
    transposed: bool,
    # outputs
    padded: wp.array2d[float],  # w or its transpose, with columns of 0
):
    k = wp.tid()
    columns = w.shape[1]
    if transposed:
        columns = w.shape[0]
    for n in range(padded.shape[1]):
        value = float(0.0)
        if n < columns:
            if transposed:
                value = w[n, k]
            else:
                value = w[k, n]
        padded[k, n] = value
