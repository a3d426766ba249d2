"""Normals from one image: one sweep of smoothing on the cones that brightness allows, in Warp.

The Taichi set has the equations. One thread takes a pixel; on the CPU, a slab of pixels.
"""

import warp as wp

from cvkern.kernels.codes.shading import GUIDED, GUIDED_FROM
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

SHARE = wp.constant(GUIDED)
FROM = wp.constant(GUIDED_FROM)


@wp.func
def _at(normals: wp.array3d[float], y: int, x: int):
    return wp.vec3(normals[y, x, 0], normals[y, x, 1], normals[y, x, 2])


@wp.func
def _on_cone(n: wp.vec3, shown: float, light: wp.vec3):
    """Return the unit vector nearest to n that a light shows as so bright."""
    along = wp.dot(n, light)
    across = n - along * light
    length = wp.sqrt(wp.dot(across, across))
    found = n
    if shown > 0.0 or along > 0.0:
        if length > 0.0:
            found = shown * light + (wp.sqrt(1.0 - shown * shown) / length) * across
        else:
            found = light
    return found


def sweep(
    before: wp.array,
    image: wp.array,
    state: wp.array,
    guide: wp.array,
    light: tuple[float, float, float],
    after: wp.array,
) -> None:
    """Write the mean of the normals around each pixel, mixed with its guide, as bright as seen.

    The state is 0 outside, 1 where the normal is known, 2 where it is sought.
    """
    inputs = [before, image, state, guide, wp.vec3(*light)]
    launch_each(_sweep, state.size, 32 * state.size, inputs, [after])


@wp.kernel
def _sweep(
    stride: int,
    first: int,
    last: int,
    before: wp.array3d[float],
    image: wp.array2d[float],
    state: wp.array2d[wp.uint8],
    guide: wp.array3d[float],
    light: wp.vec3,
    # outputs
    after: wp.array3d[float],
):
    height = state.shape[0]
    width = state.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i % width
        n = _at(before, y, x)
        if state[y, x] == wp.uint8(2):
            total = wp.vec3()
            count = float(0.0)
            for k in range(4):
                v = y + wp.where(k == 0, -1, wp.where(k == 1, 1, 0))
                u = x + wp.where(k == 2, -1, wp.where(k == 3, 1, 0))
                if v >= 0 and u >= 0 and v < height and u < width:
                    if state[v, u] != wp.uint8(0):
                        total += _at(before, v, u)
                        count += 1.0
            mean = n
            if count > 0.0:
                mean = total / count
            leading = _at(guide, y, x)
            if wp.isfinite(leading[2]):
                share = SHARE * wp.clamp((n[2] - FROM) / 0.3, 0.0, 1.0)
                mean = (1.0 - share) * mean + share * leading
            flat = mean[0] * mean[0] + mean[1] * mean[1]
            mean = wp.vec3(mean[0], mean[1], wp.sqrt(wp.max(1.0 - flat, 0.0)))
            n = _on_cone(mean, image[y, x], light)
        for c in range(3):
            after[y, x, c] = n[c]
