"""The costs of the semi-global matcher on CUDA: 16 pixels by 16 disparities a thread."""

from functools import lru_cache

import warp as wp

from ..codes import CENSUS_WEIGHT, DIFFERENCE_LIMIT, DIFFERENCE_SHIFT
from ._launch import launch, scratch
from ._paths_blocks import BLOCK, OPTIONS, text_of

wp.set_module_options(OPTIONS)

FAR = 255  # what lies behind the last disparity costs more than any that counts

# A word is a pixel: the census above, 8 bits of grey below. The words of the right image for all
# pairs of 16 pixels and 16 disparities are 31 neighbours.
_COSTS = """
    const int height = costs.shape[0], width = costs.shape[1], padded = costs.shape[2];
    const int chunks = (padded + 15) / 16, groups = (width + 15) / 16;
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int k = i % chunks * 16, begin = i / chunks % groups * 16;
    const unsigned row = i / chunks / groups;
    if (row >= (unsigned)height) return;
    const unsigned* left = words.data + (size_t)row * width;
    const unsigned* right = left + (size_t)height * width;
    unsigned word[31];
    #pragma unroll
    for (int j = 0; j < 31; ++j)
        word[j] = right[max(0, min(width - 1, begin - first - k + j - 15))];
    unsigned char* to = costs.data + ((size_t)row * width + begin) * padded + k;
    #pragma unroll
    for (int p = 0; p < 16; ++p) {
        if (begin + p >= width) break;
        const unsigned here = left[begin + p];
        unsigned packed[4] = {0, 0, 0, 0};
        #pragma unroll
        for (int j = 0; j < 16; ++j) {
            const unsigned there = word[15 + p - j];
            const int difference = abs((int)(here & 255) - (int)(there & 255)) >> SHIFT;
            unsigned cost = WEIGHT * __popc((here ^ there) >> 8) + min(difference, LIMIT);
            if (k + j >= depth) cost = FAR;
            packed[j / 4] |= cost << 8 * (j % 4);
        }
        if (aligned)
            *reinterpret_cast<uint4*>(to) = make_uint4(packed[0], packed[1], packed[2], packed[3]);
        else
            for (int j = 0; j < 16 && k + j < depth; ++j) to[j] = packed[j / 4] >> 8 * (j % 4);
        to += padded;
    }
"""


@lru_cache
def match_costs_kernel() -> wp.Kernel:
    """Return the kernel, which is compiled when it is first used."""
    text = text_of(
        _COSTS,
        BLOCK=BLOCK,
        SHIFT=DIFFERENCE_SHIFT,
        WEIGHT=CENSUS_WEIGHT,
        LIMIT=DIFFERENCE_LIMIT,
        FAR=FAR,
    )

    @wp.func_native(text)
    def match_chunk(
        words: wp.array3d[wp.uint32],
        first: int,
        depth: int,
        aligned: bool,
        costs: wp.array3d[wp.uint8],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def match_costs(
        words: wp.array3d[wp.uint32],  # (2, H, W)
        first: int,
        depth: int,
        aligned: bool,  # whether costs fall into aligned chunks
        # outputs
        costs: wp.array3d[wp.uint8],  # (H, W, depth or more)
    ):
        match_chunk(words, first, depth, aligned, costs)

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
        match_costs_kernel(),
        -(-threads // BLOCK) * BLOCK,
        [words, first, depth, aligned],
        [costs],
    )
