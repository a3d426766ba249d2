"""Weighted medians on CUDA: one thread per pixel, with its whole window in registers.

medians.py has the rule. Loops over the window are unrolled, so that its values stay in registers.
"""

from functools import lru_cache

import warp as wp

from ._none import none

_MOST = 31  # pixels of the largest window
_OPTIONS = {"enable_backward": False, "fuse_fp": False, "max_unroll": _MOST}


@lru_cache
def medians(radius: int) -> list[wp.Kernel]:
    """Return the kernels of one radius: along the rows, and down the columns."""
    return [_median(radius, down) for down in (0, 1)]


def _median(radius: int, down: int) -> wp.Kernel:
    size = 2 * radius + 1
    values_t = wp.types.vector(length=size, dtype=wp.float32)
    weights_t = wp.types.vector(length=size, dtype=wp.int32)
    along = 1 - down

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def median(
        disparity: wp.array2d[float],  # (H, W)
        guide: wp.array2d[wp.uint8],  # (H, W)
        contrast: int,
        # outputs
        smooth: wp.array2d[float],  # (H, W)
    ):
        y, x = wp.tid()
        height = disparity.shape[0]
        width = disparity.shape[1]
        center = int(guide[y, x])
        values = values_t()
        weights = weights_t()
        sums = weights_t()  # the weights of the values before or equal to each
        total = int(0)
        for i in range(wp.static(size)):
            v = wp.clamp(y + down * (i - radius), 0, height - 1)
            u = wp.clamp(x + along * (i - radius), 0, width - 1)
            value = disparity[v, u] + 0.0  # no -0
            weight = wp.max(1, contrast - wp.abs(int(guide[v, u]) - center))
            if value != value:
                weight = 0
            values[i] = value
            weights[i] = weight
            sums[i] = weight
            total += weight
        for i in range(wp.static(size)):
            for j in range(i + 1, wp.static(size)):
                before = values[i] <= values[j]
                sums[j] += wp.where(before, weights[i], 0)
                sums[i] += wp.where(before, 0, weights[j])
        best = none()
        for i in range(wp.static(size)):
            if weights[i] > 0 and 2 * sums[i] >= total and not (best <= values[i]):
                best = values[i]
        smooth[y, x] = best

    return median
