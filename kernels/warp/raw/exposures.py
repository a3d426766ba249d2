"""Merging of exposures in Warp, with one thread a pixel; the Taichi set has the equations."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
FADE, FAINTEST = wp.constant(codes.FADE), wp.constant(codes.FAINTEST)
MIDDLE = wp.constant(codes.MIDDLE)


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
    values are linear, and saturated there, and `stops` is a factor. `times` (K, 2) has seconds and
    their log2.
    """
    inputs = [frames, tables, times, order, reference, stops, most]
    count = radiance.shape[0]
    launch_each(_kernel(frames.dtype), count, 8 * frames.size, inputs, [radiance])


@lru_cache
def _kernel(scalar: Any) -> wp.Kernel:
    @wp.func
    def told(
        frames: wp.array3d[scalar],
        tables: wp.array3d[float],
        times: wp.array2d[float],
        k: int,
        i: int,
        c: int,
        most: float,
    ):
        # The weight of an exposure at a pixel, its light (linear, or log2), and that to compare.
        found = wp.vec3()
        if most > 0.0:
            value = float(frames[k, i, c])
            near = wp.clamp((most - value) * FADE / most, 0.0, 1.0)
            light = value / times[k, 0]
            found = wp.vec3(near * times[k, 0] * times[k, 0], light, wp.max(light, FAINTEST))
        else:
            code = int(frames[k, i, c])
            light = tables[code, c, 0] - times[k, 1]
            found = wp.vec3(tables[code, c, 1], light, light)
        return found

    @wp.func
    def apart(a: float, b: float, stops: float, most: float):
        found = wp.abs(a - b) > stops
        if most > 0.0:
            found = a > b * stops or b > a * stops
        return found

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
                best = told(frames, tables, times, reference, i, c, most)
                known = stops > 0.0 and best[0] > 0.0
                weights = best[0]
                total = best[0] * best[1]
                for n in range(count):
                    k = order[n]
                    if k != reference:
                        other = told(frames, tables, times, k, i, c, most)
                        if not (known and apart(other[2], best[2], stops, most)):
                            weights += other[0]
                            total += other[0] * other[1]
                found = total / wp.max(weights, FAINTEST)
                if not weights > 0.0:
                    # All too bright, as the shortest says, or all too dark.
                    k = order[0]
                    if most <= 0.0 and int(frames[k, i, c]) < MIDDLE:
                        k = order[count - 1]
                    found = told(frames, tables, times, k, i, c, most)[1]
                if most <= 0.0:
                    found = wp.pow(2.0, found)
                radiance[i, c] = found

    return merge_pixel
