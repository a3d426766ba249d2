"""Steps over the whole grid of density and colour on CUDA.

Only nodes that rays have touched learn, few of them all. The threads of a block look at 8 nodes
each and list those in shared memory; then a thread takes one of them, or four coefficients of one.
"""

import warp as wp

from cvkern.kernels.warp.radiance.training._adam_step import STEP_ON_CUDA

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

BLOCK = 256  # threads
NODES = 8  # that a thread looks at

# DENSITY for a touched `node`, and COLOR for the i-th four of all coefficients, which are of a
# touched `node`. PREPARE is before both.
_TOUCHED = f"""
    __shared__ unsigned short found[{NODES * BLOCK}];
    __shared__ int count;
    if (threadIdx.x == 0) count = 0;
    __syncthreads();
    const int all = touched.shape[0], first = {NODES} * thread;
    const int begin = first - {NODES} * threadIdx.x;  // of the block
    auto find = [&](int node) {{ found[atomicAdd(&count, 1)] = node - begin; }};
    if (first + {NODES} <= all) {{
        const unsigned long long marks = ((const unsigned long long*)touched.data)[thread];
        if (marks)
            for (int k = 0; k < {NODES}; ++k)
                if (marks >> 8 * k & 255u) find(first + k);
    }} else
        for (int node = first; node < all; ++node)
            if (touched.data[node]) find(node);
    __syncthreads();
    if (count == 0) return;
    PREPARE
    for (int n = threadIdx.x; n < count; n += {BLOCK}) {{
        const int node = begin + found[n];
        DENSITY
    }}
    const int each = width / 4, part = threadIdx.x % each;  // threads of a row of coefficients
    for (int n = threadIdx.x / each; n < count; n += {BLOCK} / each) {{
        const int node = begin + found[n], i = node * each + part;
        COLOR
    }}
"""


def threads(nodes: int) -> int:
    """Return the threads of whole blocks that look at so many nodes."""
    return -(-nodes // (NODES * BLOCK)) * BLOCK


def _text(prepare: str, density: str, color: str) -> str:
    parts = {"PREPARE": prepare, "DENSITY": density, "COLOR": color}
    text = _TOUCHED
    for name, part in parts.items():
        text = text.replace(name, part)
    return text


_VARIATION = _text(
    """
    auto add_up = [&](int at, auto add) {
        for (int axis = 0, jump = 1; axis < 3; ++axis, jump *= side) {
            const int place = at / jump % side;
            add(place > 0 ? -jump : 0);  // a neighbour that is not there counts as equal
            add(place + 1 < side ? jump : 0);
        }
    };
    """,
    """
        const float* at = density.data + node;
        float sum = 0.0f;
        add_up(node, [&](int jump) { sum += at[0] - at[jump]; });
        d_density.data[node] += weight_density * sum;
    """,
    """
        const float4* at = (const float4*)color.data + i;
        const float4 v = at[0];
        float4 sum = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        add_up(node, [&](int jump) {
            const float4 u = at[jump * each];
            sum.x += v.x - u.x;
            sum.y += v.y - u.y;
            sum.z += v.z - u.z;
            sum.w += v.w - u.w;
        });
        float4& slope = ((float4*)d_color.data)[i];
        float4 g = slope;
        g.x += weight_color * sum.x;
        g.y += weight_color * sum.y;
        g.z += weight_color * sum.z;
        g.w += weight_color * sum.w;
        slope = g;
    """,
)


@wp.func_native(_VARIATION)
def smooth(
    thread: int,
    weight_density: float,
    weight_color: float,
    touched: wp.array[wp.uint8],
    density: wp.array[float],
    color: wp.array[float],
    side: int,
    width: int,
    d_density: wp.array[float],
    d_color: wp.array[float],
): ...


@wp.kernel
def total_variation(
    weight_density: float,
    weight_color: float,
    touched: wp.array[wp.uint8],  # (N^3,)
    density: wp.array[float],  # (N^3,)
    color: wp.array[float],  # (N^3 C,)
    side: int,
    width: int,
    # outputs
    d_density: wp.array[float],  # added to
    d_color: wp.array[float],  # added to
):
    smooth(
        wp.tid(), weight_density, weight_color, touched, density, color, side, width, d_density,
        d_color,
    )  # fmt: skip


_ADAM = _text(
    f"""
    const float of_density = rate_density.data[0] / rate_density.data[1];
    const float of_color = rate_color.data[0] / rate_color.data[1];
    const float mend = 1.0f / rate_color.data[2];  // of both: the means of squares are as old
    const float shrink = factor.data[0];
    {STEP_ON_CUDA}
    """,
    """
        touched.data[node] = 0;
        step(
            d_density.data[node] * shrink, density_mean.data[node], density_square.data[node],
            density.data[node], of_density);
        d_density.data[node] = 0.0f;
    """,
    """
        const float4 g = ((float4*)d_color.data)[i];
        float4 m = ((float4*)color_mean.data)[i];
        float4 v = ((float4*)color_square.data)[i];
        float4 w = ((float4*)color.data)[i];
        step(g.x * shrink, m.x, v.x, w.x, of_color);
        step(g.y * shrink, m.y, v.y, w.y, of_color);
        step(g.z * shrink, m.z, v.z, w.z, of_color);
        step(g.w * shrink, m.w, v.w, w.w, of_color);
        ((float4*)d_color.data)[i] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        ((float4*)color_mean.data)[i] = m;
        ((float4*)color_square.data)[i] = v;
        ((float4*)color.data)[i] = w;
    """,
)


@wp.func_native(_ADAM)
def move(
    thread: int,
    rate_density: wp.array[float],
    rate_color: wp.array[float],
    factor: wp.array[float],
    beta1: float,
    beta2: float,
    epsilon: float,
    width: int,
    touched: wp.array[wp.uint8],
    d_density: wp.array[float],
    density_mean: wp.array[float],
    density_square: wp.array[float],
    density: wp.array[float],
    d_color: wp.array[float],
    color_mean: wp.array[float],
    color_square: wp.array[float],
    color: wp.array[float],
): ...


@wp.kernel
def adam(
    rate_density: wp.array[float],  # (3,)
    rate_color: wp.array[float],  # (3,)
    factor: wp.array[float],  # (1,)
    beta1: float,
    beta2: float,
    epsilon: float,
    width: int,
    # outputs
    touched: wp.array[wp.uint8],  # (N^3,): set to 0
    d_density: wp.array[float],  # (N^3,): set to 0
    density_mean: wp.array[float],
    density_square: wp.array[float],
    density: wp.array[float],
    d_color: wp.array[float],  # (N^3 C,): set to 0
    color_mean: wp.array[float],
    color_square: wp.array[float],
    color: wp.array[float],
):
    move(
        wp.tid(), rate_density, rate_color, factor, beta1, beta2, epsilon, width, touched,
        d_density, density_mean, density_square, density, d_color, color_mean, color_square, color,
    )  # fmt: skip


@wp.func_native("""
    const int i = cell % cells * size, j = cell / cells % cells * size;
    const int k = cell / (cells * cells) * size, side = density.shape[0];
    bool found = false;
    for (int z = k; z <= k + size; ++z)
        for (int y = j; y <= j + size; ++y) {
            const float* row = density.data + ((size_t)z * side + y) * side + i;
            for (int x = 0; x <= size; ++x) found |= row[x] > least;
        }
    const unsigned word = __ballot_sync(0xffffffffu, found);
    if (threadIdx.x % 32 == 0) bits.data[cell / 32] = word;
""")
def mark_cell(
    cell: int,
    density: wp.array3d[float],
    cells: int,
    size: int,
    least: float,
    bits: wp.array[wp.uint32],
): ...


@wp.kernel
def mark(
    density: wp.array3d[float],  # (N + 1, N + 1, N + 1)
    cells: int,
    size: int,  # N / cells
    least: float,
    # outputs
    bits: wp.array[wp.uint32],  # (cells^3 / 32,)
):
    mark_cell(wp.tid(), density, cells, size, least, bits)
