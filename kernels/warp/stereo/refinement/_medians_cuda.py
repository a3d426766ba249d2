"""Weighted medians on CUDA: one thread for two neighbouring pixels.

medians.py has the rule. Both windows compare the same values. The halves of a number hold their
weights, and the sums of these. A value that only one window has weighs nothing in the other. Loops
over the windows are unrolled, so that their values stay in registers.
"""

from functools import lru_cache

import warp as wp

from ._none import none

_OPTIONS = {"enable_backward": False, "fuse_fp": False, "max_unroll": 32}  # the longest window


def medians(radius: int, contrast: int) -> list[wp.Kernel]:
    """Return the kernels of one radius: along the rows, and down the columns."""
    narrow = (2 * radius + 1) * contrast < 1 << 16
    return [_median(radius, down, narrow) for down in (0, 1)]


@lru_cache
def _median(radius: int, down: int, narrow: bool) -> wp.Kernel:
    count = 2 * radius + 2  # the places of both windows
    number = wp.uint32 if narrow else wp.uint64
    bits = number(16 if narrow else 32)
    most = number((1 << (16 if narrow else 32)) - 1)
    values_t = wp.types.vector(length=count, dtype=wp.float32)
    grays_t = wp.types.vector(length=count, dtype=wp.int32)
    numbers_t = wp.types.vector(length=count, dtype=number)

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def median(
        disparity: wp.array2d[float],  # (H, W)
        guide: wp.array2d[wp.uint8],  # (H, W)
        contrast: int,
        # outputs
        smooth: wp.array2d[float],  # (H, W)
    ):
        y, x = wp.tid()
        if wp.static(down == 1):
            y = 2 * y
        else:
            x = 2 * x
        height = disparity.shape[0]
        width = disparity.shape[1]
        values = values_t()
        grays = grays_t()
        for i in range(wp.static(count)):
            v = y
            u = x
            if wp.static(down == 1):
                v = wp.clamp(y + i - wp.static(radius), 0, height - 1)
            else:
                u = wp.clamp(x + i - wp.static(radius), 0, width - 1)
            values[i] = disparity[v, u] + 0.0  # no -0
            grays[i] = int(guide[v, u])
        weights = numbers_t()
        for i in range(wp.static(count)):
            one = number(0)
            other = number(0)
            if values[i] == values[i]:
                if i < wp.static(count - 1):
                    one = number(wp.max(1, contrast - wp.abs(grays[i] - grays[wp.static(radius)])))
                if i > 0:
                    center = grays[wp.static(radius + 1)]
                    other = number(wp.max(1, contrast - wp.abs(grays[i] - center)))
            weights[i] = one | (other << wp.static(bits))
        # The sum of a value is the weight of those before or equal to it. It begins with the
        # weights from its own place on.
        sums = numbers_t()
        total = number(0)
        for k in range(wp.static(count)):
            total += weights[wp.static(count - 1) - k]
            sums[wp.static(count - 1) - k] = total
        for i in range(wp.static(count)):
            for j in range(i + 1, wp.static(count)):
                if values[i] <= values[j]:
                    sums[i] -= weights[j]
                    sums[j] += weights[i]
        # The least value whose sum reaches half of the total; NaN does not count. Sums of the high
        # half compare rightly whatever the low half is.
        half = ((total & wp.static(most)) + number(1)) / number(2)
        best = none()
        for i in range(wp.static(count - 1)):
            if (sums[i] & wp.static(most)) >= half and not (best <= values[i]):
                if values[i] == values[i]:
                    best = values[i]
        smooth[y, x] = best
        if wp.static(down == 1):
            y += 1
        else:
            x += 1
        if y < height and x < width:
            half = ((total >> wp.static(bits)) + number(1)) / number(2) << wp.static(bits)
            best = none()
            for i in range(1, wp.static(count)):
                if sums[i] >= half and not (best <= values[i]):
                    if values[i] == values[i]:
                        best = values[i]
            smooth[y, x] = best

    return median
