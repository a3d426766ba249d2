"""The costs of the semi-global matcher on CUDA: 16 pixels by 16 disparities a thread."""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.stereo import CENSUS_WEIGHT, DIFFERENCE_LIMIT, DIFFERENCE_SHIFT
from cvkern.kernels.warp._launch import launch, scratch

from ._steps_cuda import BLOCK, OPTIONS, text_of

wp.set_module_options(OPTIONS)

# A word is a pixel: the census above, 8 bits of grey below. The words of the right image for all
# pairs of 16 pixels and 16 disparities are 31 neighbours; their grey values are taken in fours.
_COSTS = """
    const int height = costs.shape[0], width = costs.shape[1], padded = costs.shape[2];
    const int chunks = (padded + 15) / 16, groups = (width + 15) / 16;
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int k = i % chunks * 16, begin = i / chunks % groups * 16;
    const unsigned row = i / chunks / groups;
    if (row >= (unsigned)height) return;
    const unsigned* left = words.data + (size_t)row * width;
    const unsigned* right = left + (size_t)height * width;
    unsigned word[31], grey[28], none[4];
    #pragma unroll
    for (int j = 0; j < 31; ++j)
        word[j] = right[max(0, min(width - 1, begin - first - k + j - 15))];
    grey[0] = __byte_perm(__byte_perm(word[3], word[2], 0x0040),
                          __byte_perm(word[1], word[0], 0x0040), 0x5410);
    #pragma unroll
    for (int j = 1; j < 28; ++j) grey[j] = __byte_perm(grey[j - 1], word[j + 3], 0x2104);
    #pragma unroll
    for (int j = 0; j < 4; ++j) {
        // What lies behind the last disparity costs 255, more than any that counts.
        const int behind = k + 4 * j + 4 - depth;
        none[j] = behind <= 0 ? 0 : behind >= 4 ? ~0u : ~0u << 8 * (4 - behind);
    }
    unsigned char* to = costs.data + ((size_t)row * width + begin) * padded + k;
    #pragma unroll
    for (int p = 0; p < 16; ++p) {
        if (begin + p >= width) break;
        const unsigned here = left[begin + p], shade = (here & 255) * 0x1010101u;
        unsigned packed[4];
        #pragma unroll
        for (int j = 0; j < 4; ++j) {
            const unsigned difference = __vabsdiffu4(shade, grey[12 + p - 4 * j]);
            const unsigned even = __vminu2(difference >> SHIFT & HALF, LIMIT * 0x10001u);
            const unsigned odd = __vminu2(difference >> 8 + SHIFT & HALF, LIMIT * 0x10001u);
            packed[j] = even + odd * 256;
            #pragma unroll
            for (int n = 0; n < 4; ++n) {
                const unsigned different = (here ^ word[15 + p - 4 * j - n]) & 0xffffff00u;
                packed[j] += __popc(different) * (WEIGHT << 8 * n);
            }
            packed[j] |= none[j];
        }
        if (ALIGNED)
            *reinterpret_cast<uint4*>(to) = make_uint4(packed[0], packed[1], packed[2], packed[3]);
        else
            for (int j = 0; j < 16 && k + j < padded; ++j) to[j] = packed[j / 4] >> 8 * (j % 4);
        to += padded;
    }
"""


@lru_cache
def match_costs_kernel(aligned: bool) -> wp.Kernel:
    """Return the kernel for costs that fall into aligned chunks, or that do not."""
    text = text_of(
        _COSTS,
        BLOCK=BLOCK,
        SHIFT=DIFFERENCE_SHIFT,
        WEIGHT=CENSUS_WEIGHT,
        LIMIT=DIFFERENCE_LIMIT,
        HALF=(255 >> DIFFERENCE_SHIFT) * 0x10001,
        ALIGNED=int(aligned),
    )

    @wp.func_native(text)
    def match_chunk(
        words: wp.array3d[wp.uint32],
        first: int,
        depth: int,
        costs: wp.array3d[wp.uint8],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def match_costs(
        words: wp.array3d[wp.uint32],  # (2, H, W)
        first: int,
        depth: int,
        # outputs
        costs: wp.array3d[wp.uint8],  # (H, W, depth or more)
    ):
        match_chunk(words, first, depth, costs)

    return match_costs


@wp.kernel
def pack(
    left_bits: wp.array2d[wp.uint64],
    right_bits: wp.array2d[wp.uint64],
    left: wp.array2d[wp.uint8],
    right: wp.array2d[wp.uint8],
    # outputs
    words: wp.array3d[wp.uint32],  # (2, H, W)
):
    y, x = wp.tid()
    words[0, y, x] = (wp.uint32(left_bits[y, x]) << wp.uint32(8)) | wp.uint32(left[y, x])
    words[1, y, x] = (wp.uint32(right_bits[y, x]) << wp.uint32(8)) | wp.uint32(right[y, x])


def match_costs(
    left_bits: wp.array,
    right_bits: wp.array,
    left: wp.array,
    right: wp.array,
    first: int,
    depth: int,
    costs: wp.array,
) -> None:
    """Fill a volume of `depth` disparities, or of more, with costs that never win, up to 16."""
    height, width, padded = costs.shape
    words = scratch("match.words", (2, height, width), wp.uint32, costs.device)
    launch(pack, (height, width), [left_bits, right_bits, left, right], [words])
    threads = height * -(-width // 16) * -(-padded // 16)
    aligned = padded % 16 == 0 and costs.ptr % 16 == 0
    launch(
        match_costs_kernel(aligned),
        -(-threads // BLOCK) * BLOCK,
        [words, first, depth],
        [costs],
    )
