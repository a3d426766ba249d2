"""One view from the planes of several reference cameras, in Taichi; one thread per ray.

Reference camera k has given a ray the colour C_k, premultiplied, the opacity O_k and the depth D_k.
With its place e_k and a sharpness s_k, a ray from o has

    w_k = e^(-s_k |o - e_k|),    S = sum w_k O_k,    v_k = w_k O_k / S,
    C = sum v_k C_k,    O = sum v_k O_k,    D = sum v_k D_k,

and nothing where S is 0. So one camera alone changes nothing, and a camera that does not see a part
of the view leaves it to the others. With gradients g by these,

    dL/dC_k = v_k g_C,    dL/dD_k = v_k g_D,    dL/dO_k = v_k g_O + (w_k / S) (L_k - L),
    L_k = <g_C, C_k> + g_O O_k + g_D D_k,    L = <g_C, C> + g_O O + g_D D.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import primitive, scratch

from ._totals import total

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def _decay(origins: ti.template(), eyes: ti.template(), k: ti.i32, ray: ti.i32) -> ti.f32:
    """Return the exponent of a camera's weight, without its sign."""
    away = vec3(0.0)
    for i in ti.static(range(3)):
        away[i] = origins[ray, i] - eyes[k, i]
    return eyes[k, 3] * away.norm()


@ti.kernel
def _weigh(
    origins: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    eyes: f32_2,  # (K, 4)
    part_opacity: f32_1,  # (K R,)
    # outputs
    weights: f32_2,  # (K + 1, R): relative to the largest one, which is 1, and S at the end
):
    for ray in range(ti.min(active[0], origins.shape[0])):
        least = _decay(origins, eyes, 0, ray)
        for k in range(1, eyes.shape[0]):
            least = ti.min(least, _decay(origins, eyes, k, ray))
        total = 0.0
        for k in range(eyes.shape[0]):
            weights[k, ray] = ti.exp(least - _decay(origins, eyes, k, ray))
            total += weights[k, ray] * part_opacity[k * origins.shape[0] + ray]
        weights[eyes.shape[0], ray] = total


@ti.kernel
def _blend(
    active: i32_1,  # (1,)
    weights: f32_2,  # (K + 1, R)
    part_colors: f32_2,  # (K R, 3)
    part_opacity: f32_1,  # (K R,)
    part_depths: f32_1,  # (K R,)
    # outputs
    colors: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depths: f32_1,  # (R,)
):
    for ray in range(ti.min(active[0], weights.shape[1])):
        color = vec3(0.0)
        shown = 0.0
        depth = 0.0
        for k in range(weights.shape[0] - 1):
            at = k * weights.shape[1] + ray
            share = weights[k, ray] * part_opacity[at]
            if share > 0.0:
                share /= weights[weights.shape[0] - 1, ray]
                for c in ti.static(range(3)):
                    color[c] += share * part_colors[at, c]
                shown += share * part_opacity[at]
                depth += share * part_depths[at]
        for c in ti.static(range(3)):
            colors[ray, c] = color[c]
        opacity[ray] = shown
        depths[ray] = depth


def _weights(rays: codes.Rays, eyes: np.ndarray, opacity: np.ndarray) -> np.ndarray:
    """Return the weights of cameras for rays, and the sums S."""
    weights = scratch((eyes.shape[0] + 1, rays.origins.shape[0]), np.float32)
    _weigh(rays.origins, rays.active, eyes, opacity, weights)
    return weights


@primitive
def blend(rays: codes.Rays, eyes: np.ndarray, parts: codes.Seen, seen: codes.Seen) -> None:
    """Blend what K reference cameras give the first `active` rays, `parts`, camera by camera.

    The arrays of `parts` have K R rows. `eyes` (K, 4) are the cameras' places and sharpnesses.
    """
    _blend(rays.active, _weights(rays, eyes, parts.opacity), *parts, *seen)


@ti.kernel
def _back(
    d_colors: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_depths: f32_1,  # (R,)
    active: i32_1,  # (1,)
    weights: f32_2,  # (K + 1, R)
    part_colors: f32_2,  # (K R, 3)
    part_opacity: f32_1,  # (K R,)
    part_depths: f32_1,  # (K R,)
    totals: f32_1,  # (R,): L
    # outputs
    d_part_colors: f32_2,  # (K R, 3)
    d_part_opacity: f32_1,  # (K R,)
    d_part_depths: f32_1,  # (K R,)
):
    for ray in range(ti.min(active[0], weights.shape[1])):
        for k in range(weights.shape[0] - 1):
            at = k * weights.shape[1] + ray
            weight = 0.0
            if weights[weights.shape[0] - 1, ray] > 0.0:
                weight = weights[k, ray] / weights[weights.shape[0] - 1, ray]
            share = weight * part_opacity[at]
            own = d_opacity[ray] * part_opacity[at] + d_depths[ray] * part_depths[at]
            for c in ti.static(range(3)):
                own += d_colors[ray, c] * part_colors[at, c]
                d_part_colors[at, c] = share * d_colors[ray, c]
            d_part_opacity[at] = share * d_opacity[ray] + weight * (own - totals[ray])
            d_part_depths[at] = share * d_depths[ray]


@primitive
def blend_backward(
    d_seen: codes.Seen,
    rays: codes.Rays,
    eyes: np.ndarray,
    parts: codes.Seen,
    seen: codes.Seen,
    d_parts: codes.Seen,
) -> None:
    """Fill the gradients `d_parts` of the first `active` rays, given those by :func:`blend`."""
    totals = scratch((rays.origins.shape[0],), np.float32)
    total(*d_seen, rays.active, *seen, totals)
    _back(*d_seen, rays.active, _weights(rays, eyes, parts.opacity), *parts, totals, *d_parts)
