"""Sums on CUDA that are always made in the same order: of a block's threads, and of parts."""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK

wp.set_module_options({"enable_backward": False})

WARPS = BLOCK // 32

# Once in a function: the sum of a number of each thread of a block, in all of them.
SUM_OF_BLOCK = f"""
    __shared__ float sums_of_warps[{WARPS}];
    auto sum_of_block = [&](float x) {{
        for (int s = 16; s; s /= 2) x += __shfl_xor_sync(0xffffffffu, x, s);
        if (threadIdx.x % 32 == 0) sums_of_warps[threadIdx.x / 32] = x;
        __syncthreads();
        x = 0.0f;
        for (int warp = 0; warp < {WARPS}; ++warp) x += sums_of_warps[warp];
        return x;
    }};
"""


@wp.func_native(f"""
    // A block has 32 columns; each of its warps adds up its share of the parts, the first one all.
    __shared__ float shares[{WARPS}][32];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, column = blockIdx.x * 32 + lane;
    const int count = parts.shape[0], last = count * (warp + 1) / {WARPS};
    float sum = 0.0f;
    #pragma unroll 8
    for (int part = count * warp / {WARPS}; part < last; ++part)
        sum += parts.data[(size_t)part * parts.shape[1] + column];
    shares[warp][lane] = sum;
    __syncthreads();
    if (warp) return;
    for (int other = 1; other < {WARPS}; ++other) sum += shares[other][lane];
    sums.data[column] += sum;
""")
def add_up(parts: wp.array2d[float], sums: wp.array[float]): ...


@wp.kernel
def gather(
    parts: wp.array2d[float],  # (P, N), N a multiple of 32
    # outputs
    sums: wp.array[float],  # (N,): added to
):
    add_up(parts, sums)


def threads(columns: int) -> int:
    """Return how many threads add up so many columns, in blocks of BLOCK."""
    return columns // 32 * BLOCK
