"""The mean of an occupancy grid, and which cells are above it, on CUDA."""

import warp as wp

from cvkern.kernels.warp.radiance._sums_cuda import SUM_OF_BLOCK

wp.set_module_options({"enable_backward": False})

BLOCKS = 1024  # that mark, at most


@wp.func_native(f"""{SUM_OF_BLOCK}
    const float4* four = (const float4*)density.data;
    const int fours = density.shape[0] / 4;
    float x = 0.0f;
    for (int i = blockIdx.x * blockDim.x + threadIdx.x; i < fours; i += gridDim.x * blockDim.x) {{
        const float4 v = four[i];
        x += (v.x + v.y) + (v.z + v.w);
    }}
    x = sum_of_block(x);
    if (threadIdx.x == 0) parts.data[blockIdx.x] = x;
""")
def sum_cells(density: wp.array[float], parts: wp.array[float]): ...


@wp.func_native(f"""{SUM_OF_BLOCK}
    const float4* four = (const float4*)density.data;
    const int fours = density.shape[0] / 4;
    float x = 0.0f;
    for (int i = threadIdx.x; i < parts.shape[0]; i += blockDim.x) x += parts.data[i];
    const float bound = fminf(least, sum_of_block(x) / (float)density.shape[0]);
    if (blockIdx.x == 0 && threadIdx.x == 0) limit.data[0] = bound;
    const int nibble = threadIdx.x % 8;  // eight lanes make a word
    for (int first = blockIdx.x * blockDim.x; first < fours; first += gridDim.x * blockDim.x) {{
        const int i = first + threadIdx.x;
        const float4 v = four[min(i, fours - 1)];
        const unsigned low = (v.x > bound) | (v.y > bound) << 1;
        unsigned word = (low | (v.z > bound) << 2 | (v.w > bound) << 3) << 4 * nibble;
        for (int s = 1; s < 8; s *= 2) word |= __shfl_xor_sync(0xffffffffu, word, s);
        if (nibble == 0 && i < fours) bits.data[i / 8] = word;
    }}
""")
def mark_cells(
    density: wp.array[float],
    parts: wp.array[float],
    least: float,
    limit: wp.array[float],
    bits: wp.array[wp.uint32],
): ...


@wp.kernel
def sum_parts(
    density: wp.array[float],  # (count,)
    # outputs
    parts: wp.array[float],  # (P,)
):
    """Sum a share of the cells in each block."""
    sum_cells(density, parts)


@wp.kernel
def mark(
    density: wp.array[float],  # (count,)
    parts: wp.array[float],  # (P,)
    least: float,
    # outputs
    limit: wp.array[float],  # (1,)
    bits: wp.array[wp.uint32],  # (count / 32,)
):
    """Sum the parts in each block, and set bits."""
    mark_cells(density, parts, least, limit, bits)
