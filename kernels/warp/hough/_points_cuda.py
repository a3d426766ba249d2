"""The set pixels of a mask on CUDA: one warp a row, 16 pixels a lane."""

import warp as wp

wp.set_module_options({"enable_backward": False})

BLOCK = 256  # threads; Warp's own
WARPS = BLOCK // 32


def dim(mask: wp.array) -> int:
    """Return the number of threads: one warp a row, whole blocks."""
    return -(-mask.shape[0] // WARPS) * BLOCK


def in_words(mask: wp.array) -> bool:
    """Tell whether every row falls into aligned words of 16 bytes."""
    return mask.shape[1] % 16 == 0 and mask.ptr % 16 == 0


# Bit k of `bits`: whether pixel x + k of a row is set, for 16 pixels from x on.
_BITS = """
    unsigned int bits = 0;
    if (words && x < columns) {
        const uint4 w = *reinterpret_cast<const uint4*>(pixel + x);
        const unsigned int four[4] = {w.x, w.y, w.z, w.w};
        #pragma unroll
        for (int k = 0; k < 4; ++k) {  // bytes of 255, one bit of each, moved into four bits
            const unsigned int ones = __vcmpne4(four[k], 0u) & 0x08040201u;
            bits |= ((ones * 0x01010101u) >> 24 & 15u) << 4 * k;
        }
    } else {
        for (int k = 0; k < 16 && x + k < columns; ++k) bits |= (pixel[x + k] != 0) << k;
    }
"""
_ROW = """
    const int y = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    const int columns = mask.shape[1];
    if (y >= mask.shape[0]) return;
    const unsigned char* pixel = mask.data + (size_t)y * columns;
"""


@wp.func_native(f"""{_ROW}
    int number = 0;
    for (int x = 16 * lane; x < columns; x += 512) {{
        {_BITS}
        number += __popc(bits);
    }}
    #pragma unroll
    for (int step = 16; step; step /= 2) number += __shfl_xor_sync(0xffffffffu, number, step);
    if (lane == 0) starts.data[y + 1] = number;
""")
def count_row(mask: wp.array2d[wp.uint8], words: bool, starts: wp.array[int]): ...


@wp.kernel
def count(
    mask: wp.array2d[wp.uint8],  # (H, W)
    words: bool,
    # outputs
    starts: wp.array[int],  # (H + 1,): for now the number in each row, one place later
):
    count_row(mask, words, starts)


@wp.func_native("""
    // One block: a thread adds up its share, the shares are added up by halves, then its share.
    __shared__ int sums[256];
    const int t = threadIdx.x, length = starts.shape[0] - 1;
    const int share = (length + 255) / 256;
    const int first = 1 + t * share;
    const int last = first + share < length + 1 ? first + share : length + 1;
    int sum = 0;
    for (int i = first; i < last; ++i) sum += starts.data[i];
    sums[t] = sum;
    __syncthreads();
    for (int step = 1; step < 256; step *= 2) {
        const int before = t >= step ? sums[t - step] : 0;
        __syncthreads();
        sums[t] += before;
        __syncthreads();
    }
    int total = sums[t] - sum;
    for (int i = first; i < last; ++i) starts.data[i] = total += starts.data[i];
    if (t == 0) starts.data[0] = 0;
""")
def add_up_in_a_block(starts: wp.array[int]): ...


@wp.kernel
def add_up(
    # outputs
    starts: wp.array[int],  # (H + 1,)
):
    add_up_in_a_block(starts)


@wp.func_native(f"""{_ROW}
    int next = starts.data[y];
    if (starts.data[y + 1] == next) return;
    for (int left = 0; left < columns; left += 512) {{
        const int x = left + 16 * lane;
        {_BITS}
        const int number = __popc(bits);
        int upto = number;  // of this lane and those before it
        #pragma unroll
        for (int step = 1; step < 32; step *= 2) {{
            const int before = __shfl_up_sync(0xffffffffu, upto, step);
            if (lane >= step) upto += before;
        }}
        int2* to = reinterpret_cast<int2*>(points.data) + next + upto - number;
        while (bits) {{
            *to++ = make_int2(y, x + __ffs(bits) - 1);
            bits &= bits - 1;
        }}
        next += __shfl_sync(0xffffffffu, upto, 31);
    }}
""")
def gather_row(
    mask: wp.array2d[wp.uint8], starts: wp.array[int], words: bool, points: wp.array2d[int]
): ...


@wp.kernel
def gather(
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H + 1,)
    words: bool,
    # outputs
    points: wp.array2d[int],  # (capacity, 2)
):
    gather_row(mask, starts, words, points)


@wp.kernel
def number_of(
    starts: wp.array[int],  # (H + 1,)
    # outputs
    index: wp.array[int],  # (1,)
):
    index[0] = starts[starts.shape[0] - 1]


@wp.kernel
def first_outside(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],  # (H + 1,)
    values: wp.array2d[float],  # (H, W)
    low: float,
    high: float,
    # outputs
    index: wp.array[int],  # (1,)
):
    i = wp.tid()
    if i < starts[starts.shape[0] - 1]:
        value = values[points[i, 0], points[i, 1]]
        if not (value >= low and value <= high):
            wp.atomic_min(index, 0, i)
