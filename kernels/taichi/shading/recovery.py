"""Normals from one image: one sweep of smoothing on the cones that brightness allows, in Taichi.

Under a light l, a matt pixel of brightness I has a normal on the cone ``n . l = I`` [Worthington
and Hancock 1999]. Its neighbours tell which normal of the cone it is: their n_x and n_y are
averaged, n_z follows from both, and the nearest vector of the cone is taken. This is exact for a
sphere, whose n_x and n_y are linear. The normals are then drawn towards a guide, those of the depth
that fits best, because not every field of normals belongs to a surface. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.shading import GUIDED, GUIDED_FROM
from cvkern.kernels.taichi._launch import primitive

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def _at(normals: ti.template(), y: ti.i32, x: ti.i32) -> vec3:
    return vec3(normals[y, x, 0], normals[y, x, 1], normals[y, x, 2])


@ti.func
def _on_cone(n: vec3, shown: ti.f32, light: vec3) -> vec3:
    """Return the unit vector nearest to n that a light shows as so bright."""
    along = n.dot(light)
    across = n - along * light
    length = ti.sqrt(across.dot(across))
    found = n
    if shown > 0.0 or along > 0.0:
        if length > 0.0:
            found = shown * light + (ti.sqrt(1.0 - shown * shown) / length) * across
        else:
            found = light
    return found


@ti.kernel
def _sweep(before: f32_3, image: f32_2, state: u8_2, guide: f32_3, light: vec3, after: f32_3):
    height = state.shape[0]
    width = state.shape[1]
    for y, x in state:
        n = _at(before, y, x)
        if state[y, x] == 2:
            total = vec3(0.0)
            count = 0.0
            for k in ti.static(range(4)):
                v = y + ti.static((-1, 1, 0, 0)[k])
                u = x + ti.static((0, 0, -1, 1)[k])
                if 0 <= v < height and 0 <= u < width:
                    if state[v, u] != 0:
                        total += _at(before, v, u)
                        count += 1.0
            mean = n
            if count > 0.0:
                mean = total / count
            leading = _at(guide, y, x)
            if leading[2] == leading[2]:
                share = GUIDED * ti.math.clamp((n[2] - GUIDED_FROM) / 0.3, 0.0, 1.0)
                mean = (1.0 - share) * mean + share * leading
            flat = mean[0] * mean[0] + mean[1] * mean[1]
            mean = vec3(mean[0], mean[1], ti.sqrt(ti.max(1.0 - flat, 0.0)))
            n = _on_cone(mean, image[y, x], light)
        for c in ti.static(range(3)):
            after[y, x, c] = n[c]


@primitive
def sweep(
    before: np.ndarray,
    image: np.ndarray,
    state: np.ndarray,
    guide: np.ndarray,
    light: tuple[float, float, float],
    after: np.ndarray,
) -> None:
    """Write the mean of the normals around each pixel, mixed with its guide, as bright as seen.

    The state is 0 outside, 1 where the normal is known, 2 where it is sought.
    """
    _sweep(before, image, state, guide, vec3(*light), after)
