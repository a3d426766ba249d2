"""Merging of exposures in Warp, with one thread a pixel; the Taichi set has the equations."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}


def merge(
    frames: wp.array,
    tables: wp.array,
    times: wp.array,
    order: wp.array,
    reference: int,
    stops: float,
    most: float,
    radiance: wp.array,
) -> None:
    """Merge (K, N, C) values; `order` has the exposures from the shortest to the longest.

    `tables` (256, C, 2) has log2 exposures and weights of values, unless `most` is above 0: then
    values are linear, and saturated there. `times` (K, 2) has seconds and their log2.
    """
    inputs = [frames, tables, times, order, reference, stops, most]
    count = radiance.shape[0]
    launch_each(_kernel(frames.dtype), count, 8 * frames.size, inputs, [radiance])


@lru_cache
def _kernel(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def merge_pixel(
        stride: int,
        first: int,
        last: int,
        frames: wp.array3d[scalar],
        tables: wp.array3d[float],
        times: wp.array2d[float],
        order: wp.array[int],
        reference: int,
        stops: float,
        most: float,
        # outputs
        radiance: wp.array2d[float],
    ):
        count = frames.shape[0]
        for i in range(first + wp.tid(), last, stride):
            for c in range(radiance.shape[1]):
                total = float(0.0)
                weights = float(0.0)
                # The exposures, from the one that all others are compared with on.
                compared = float(0.0)
                known = bool(False)
                for n in range(count + 1):
                    k = reference
                    if n > 0:
                        k = order[n - 1]
                    if n == 0 or k != reference:
                        log_light = float(0.0)
                        w = float(0.0)
                        light = float(0.0)
                        if most > 0.0:
                            value = float(frames[k, i, c])
                            near = (most - value) * 16.0 / most
                            w = wp.clamp(near, 0.0, 1.0) * times[k, 0] * times[k, 0]
                            light = value / times[k, 0]
                            log_light = wp.log2(wp.max(light, 1.0e-30))
                        else:
                            code = int(frames[k, i, c])
                            w = tables[code, c, 1]
                            log_light = tables[code, c, 0] - times[k, 1]
                            light = log_light
                        if n == 0:
                            known = stops > 0.0 and w > 0.0
                            compared = log_light
                        elif known and wp.abs(log_light - compared) > stops:
                            w = 0.0
                        total += w * light
                        weights += w
                found = total / wp.max(weights, 1.0e-30)
                if not weights > 0.0:
                    # All too bright, as the shortest says, or all too dark.
                    k = order[0]
                    if most > 0.0:
                        found = float(frames[k, i, c]) / times[k, 0]
                    else:
                        code = int(frames[k, i, c])
                        if code < 128:
                            k = order[count - 1]
                            code = int(frames[k, i, c])
                        found = tables[code, c, 0] - times[k, 1]
                if most <= 0.0:
                    found = wp.pow(2.0, found)
                radiance[i, c] = found

    return merge_pixel
