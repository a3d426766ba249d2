"""Least squares of photometric stereo on the CPU, 64 pixels at once.

Between the pass that solves and the one that compares, the pixels stay in the cache.
"""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import WIDE, f32_wide, vectors
from cvkern.kernels.warp._launch import launch_slabs, slabs, view

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def solve_lanes(
    images: wp.array,
    inverse: wp.array,
    lights: wp.array,
    mask: wp.array,
    normals: wp.array,
    albedo: wp.array,
    residual: wp.array,
) -> None:
    """Write least squares of at least 64 pixels, which need not know their rows."""
    size = albedo.size
    pixels = vectors(view(images, wp.float32, (images.shape[0], size)), f32_wide)
    inputs = [pixels, inverse, lights, view(mask, wp.uint8, (mask.size,))]
    outputs = [
        view(normals, wp.vec3, (size,)),
        *(view(a, wp.float32, (size,)) for a in (albedo, residual)),
    ]
    blocks = -(-size // WIDE)
    launch_slabs(_solve, blocks, slabs(blocks, 2 * images.size), inputs, outputs)


@wp.kernel
def _solve(
    slab: int,
    first: int,
    last: int,
    images: wp.array2d[f32_wide],  # (K, H W - 63)
    inverse: wp.array2d[float],  # (3, K)
    lights: wp.array2d[float],  # (K, 4)
    mask: wp.array[wp.uint8],
    # outputs
    normals: wp.array[wp.vec3],
    albedo: wp.array[float],
    residual: wp.array[float],
):
    for block in range(first, last):
        begin = wp.min(block * WIDE, albedo.shape[0] - WIDE)
        a = f32_wide()
        b = f32_wide()
        c = f32_wide()
        for k in range(images.shape[0]):
            value = images[k, begin]
            a += inverse[0, k] * value
            b += inverse[1, k] * value
            c += inverse[2, k] * value
        total = f32_wide()
        for k in range(images.shape[0]):
            e = lights[k, 0] * a + lights[k, 1] * b + lights[k, 2] * c
            off = images[k, begin] - wp.max(e, f32_wide())
            total += wp.cw_mul(off, off)
        for i in range(WIDE):
            length = wp.sqrt(a[i] * a[i] + b[i] * b[i] + c[i] * c[i])
            found = length > 0.0 and wp.isfinite(length)
            if mask.shape[0] > 0:
                found = found and mask[begin + i] != wp.uint8(0)
            normal = wp.vec3(wp.nan, wp.nan, wp.nan)
            strength = float(0.0)
            left = float(0.0)
            if found:
                normal = wp.vec3(a[i] / length, b[i] / length, c[i] / length)
                strength = length
                left = wp.sqrt(total[i] / float(images.shape[0]))
            normals[begin + i] = normal
            albedo[begin + i] = strength
            residual[begin + i] = left
