"""One view from the planes of several reference cameras, in Warp; the Taichi set has the equations.

A thread takes a ray.
"""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._structs import Rays, Seen

wp.set_module_options({"enable_backward": False})


@wp.func
def decay_of(rays: Rays, eyes: wp.array2d[float], k: int, ray: int) -> float:
    """Return the exponent of a camera's weight, without its sign."""
    away = wp.vec3(
        rays.origins[ray, 0] - eyes[k, 0],
        rays.origins[ray, 1] - eyes[k, 1],
        rays.origins[ray, 2] - eyes[k, 2],
    )
    return eyes[k, 3] * wp.length(away)


@wp.func
def least_of(rays: Rays, eyes: wp.array2d[float], ray: int) -> float:
    """Return the least exponent, which all weights are multiplied by: the largest one is 1."""
    least = decay_of(rays, eyes, 0, ray)
    for k in range(1, eyes.shape[0]):
        least = wp.min(least, decay_of(rays, eyes, k, ray))
    return least


@wp.func
def total_of(
    rays: Rays, eyes: wp.array2d[float], opacity: wp.array[float], least: float, ray: int
) -> float:
    """Return the sum of the cameras' weights times their opacities."""
    total = float(0.0)
    for k in range(eyes.shape[0]):
        weight = wp.exp(least - decay_of(rays, eyes, k, ray))
        total += weight * opacity[k * rays.origins.shape[0] + ray]
    return total


@wp.kernel
def blend_kernel(
    stride: int,
    first: int,
    last: int,
    rays: Rays,
    eyes: wp.array2d[float],  # (K, 4)
    parts: Seen,  # K R rays
    # outputs
    seen: Seen,
):
    """Blend a ray."""
    for ray in range(first + wp.tid(), last, stride):
        if ray < rays.active[0]:
            least = least_of(rays, eyes, ray)
            total = total_of(rays, eyes, parts.opacity, least, ray)
            color = wp.vec3(0.0, 0.0, 0.0)
            shown = float(0.0)
            depth = float(0.0)
            for k in range(eyes.shape[0]):
                at = k * rays.origins.shape[0] + ray
                share = wp.exp(least - decay_of(rays, eyes, k, ray)) * parts.opacity[at]
                if share > 0.0:
                    share /= total
                    color += share * wp.vec3(
                        parts.color[at, 0], parts.color[at, 1], parts.color[at, 2]
                    )
                    shown += share * parts.opacity[at]
                    depth += share * parts.depth[at]
            for c in range(3):
                seen.color[ray, c] = color[c]
            seen.opacity[ray] = shown
            seen.depth[ray] = depth


def blend(rays: codes.Rays, eyes: wp.array, parts: codes.Seen, seen: codes.Seen) -> None:
    """Blend what K reference cameras give the first `active` rays, `parts`, camera by camera.

    The arrays of `parts` have K R rows. `eyes` (K, 4) are the cameras' places and sharpnesses.
    """
    count, cameras = rays.origins.shape[0], eyes.shape[0]
    inputs = [struct_of(Rays, rays), eyes, struct_of(Seen, parts)]
    launch_each(blend_kernel, count, 32 * cameras * count, inputs, [struct_of(Seen, seen)])


@wp.kernel
def back_kernel(
    stride: int,
    first: int,
    last: int,
    d_seen: Seen,
    rays: Rays,
    eyes: wp.array2d[float],  # (K, 4)
    parts: Seen,  # K R rays
    seen: Seen,
    # outputs
    d_parts: Seen,  # K R rays
):
    """Propagate the gradients of a ray back to its parts."""
    for ray in range(first + wp.tid(), last, stride):
        if ray < rays.active[0]:
            g = wp.vec3(d_seen.color[ray, 0], d_seen.color[ray, 1], d_seen.color[ray, 2])
            g_opacity = d_seen.opacity[ray]
            g_depth = d_seen.depth[ray]
            c = wp.vec3(seen.color[ray, 0], seen.color[ray, 1], seen.color[ray, 2])
            loss = wp.dot(g, c) + g_opacity * seen.opacity[ray] + g_depth * seen.depth[ray]
            least = least_of(rays, eyes, ray)
            total = total_of(rays, eyes, parts.opacity, least, ray)
            for k in range(eyes.shape[0]):
                at = k * rays.origins.shape[0] + ray
                weight = float(0.0)
                if total > 0.0:
                    weight = wp.exp(least - decay_of(rays, eyes, k, ray)) / total
                share = weight * parts.opacity[at]
                own = g_opacity * parts.opacity[at] + g_depth * parts.depth[at]
                for i in range(3):
                    own += g[i] * parts.color[at, i]
                    d_parts.color[at, i] = share * g[i]
                d_parts.opacity[at] = share * g_opacity + weight * (own - loss)
                d_parts.depth[at] = share * g_depth


def blend_backward(
    d_seen: codes.Seen,
    rays: codes.Rays,
    eyes: wp.array,
    parts: codes.Seen,
    seen: codes.Seen,
    d_parts: codes.Seen,
) -> None:
    """Fill the gradients `d_parts` of the first `active` rays, given those by :func:`blend`."""
    count, cameras = rays.origins.shape[0], eyes.shape[0]
    given = struct_of(Seen, d_seen), struct_of(Rays, rays), eyes
    inputs = [*given, struct_of(Seen, parts), struct_of(Seen, seen)]
    launch_each(back_kernel, count, 32 * cameras * count, inputs, [struct_of(Seen, d_parts)])
