"""Words of patches on CUDA: exact products of bytes on tensor cores, or a thread a patch."""

from functools import cache

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = 128  # threads of a block on tensor cores
ROWS = 64  # patches of such a block
OLDEST = 80  # architecture: `mma` has these products of bytes since then
OPTIONS = {"enable_backward": False, "fuse_fp": False}


@cache
def match(words: int, most: int) -> wp.Kernel:
    """Return the kernel for patches of so many words of four bytes, and so many matches of each."""

    @_native.kernel("_words_cuda.cu", OPTIONS, WORDS=words, MOST=most)
    def match(
        patches: wp.array2d[wp.uint32],  # (N, D / 4)
        words: wp.array2d[wp.uint32],  # (K, D / 4)
        least: int,
        # outputs
        products: wp.array2d[int],  # (N, M)
        matches: wp.array2d[int],  # (N, M)
    ): ...

    return match


@wp.kernel
def match_any(
    patches: wp.array2d[wp.int8],  # (N, D)
    words: wp.array2d[wp.int8],  # (K, D)
    least: int,
    # outputs
    products: wp.array2d[int],  # (N, M)
    matches: wp.array2d[int],  # (N, M)
):
    i = wp.tid()
    most = matches.shape[1]
    found = int(0)
    for word in range(words.shape[0]):
        dot = int(0)
        for k in range(patches.shape[1]):
            dot += int(patches[i, k]) * int(words[word, k])
        if dot >= least and (found < most or dot > products[i, most - 1]):
            at = wp.min(found, most - 1)
            while at > 0 and products[i, wp.max(at - 1, 0)] < dot:
                products[i, at] = products[i, at - 1]
                matches[i, at] = matches[i, at - 1]
                at -= 1
            products[i, at] = dot
            matches[i, at] = word
            found = wp.min(found + 1, most)
    for m in range(found, most):
        products[i, m] = 0
        matches[i, m] = -1
