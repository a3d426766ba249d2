"""Sums over samples that were made in parts, added up on CUDA: always in the same order."""

import warp as wp

wp.set_module_options({"enable_backward": False})

BLOCK = 256
WARPS = BLOCK // 32


# A block has 32 columns; each of its warps adds up its share of the parts, and the first all.
ADD_UP = f"""
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
"""


@wp.func_native(ADD_UP)
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
