"""Gradients of splats on CUDA: a warp takes splats that follow one another."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._harmonics import harmonics, vec16

from ._placing import Placed, arm_of, dot, placed
from ._slopes import add_moves, entries_of, total_of, turned, vec9
from ._structs import Lists, Sight, Splats

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 128  # threads of a block: its coefficients take 33 KiB
MOST = 45  # coefficients of a splat, at most
vec19 = wp.types.vector(19, wp.float32)


@_native.func_native(
    "_projection_cuda.cu", WARPS=BLOCK // 32, MOST=MOST, vec19="wp::vec_t<19, wp::float32>"
)
def add_sides(
    n: int,
    wanted: bool,
    h: vec16,
    own: wp.vec3,
    g: wp.vec3,
    sides: wp.array2d[float],
    d_sides: wp.array2d[float],
) -> vec19: ...


@wp.kernel(launch_bounds=(BLOCK, 4))
def project_backward(
    splats: Splats,
    sight: Sight,
    lists: Lists,
    slopes: wp.array2d[float],  # (E, 9): gradients by a splat on the screen, entry by entry
    # outputs
    d_splats: Splats,
):
    """Add the gradients of a splat."""
    n = wp.tid()
    s = vec9()
    p = Placed()
    h = vec16()
    own = wp.vec3()
    unit = wp.vec3()
    distance = float(1.0)
    wanted = bool(False)
    if n < lists.ranks.shape[0]:
        entries = entries_of(lists, n, slopes.shape[0])
        wanted = entries[0] < entries[1]
        if wanted:
            s = total_of(slopes, entries)
            p = placed(splats, sight, n)
            arm = arm_of(splats, sight, n)
            distance = wp.sqrt(dot(arm, arm))
            unit = wp.vec3(arm[0] / distance, arm[1] / distance, arm[2] / distance)
            h = harmonics(unit[0], unit[1], unit[2])
            for channel in range(3):
                own[channel] = 0.5 + h[0] * splats.colors[n, channel]
    g = wp.vec3(s[6], s[7], s[8])
    found = add_sides(n, wanted, h, own, g, splats.sides, d_splats.sides)
    if wanted:
        w = vec16()
        for k in range(16):
            w[k] = found[k]
        for channel in range(3):
            d_splats.colors[n, channel] = d_splats.colors[n, channel] + h[0] * found[16 + channel]
        moved = turned(unit[0], unit[1], unit[2], distance, w)
        add_moves(p, s, moved, splats, sight, n, d_splats)
