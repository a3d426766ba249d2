"""Solids by their signed distances, traced and shaded, in Warp.

A ray advances by the distance to the nearest surface [Hart 1996, "Sphere tracing"]. A hit is lit by
a sun with soft shadows and by a sky; glossy paint reflects both.
"""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Pattern, Shape
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._space import row
from cvkern.kernels.warp.radiance._structs import Solids

wp.set_module_options({"enable_backward": False})

STEPS = wp.constant(96)
NEAR = wp.constant(1e-3)  # distance at which a ray has hit a surface
SHADOW_STEPS = wp.constant(32)
SOFT = wp.constant(14.0)  # one over the tangent of half the sun's apparent size
FEWEST_CUBES, MORE_CUBES = wp.constant(codes.FEWEST_CUBES), wp.constant(codes.MORE_CUBES)
SUN = wp.constant(wp.vec3(2.3, 2.1, 1.8))
ZENITH = wp.constant(wp.vec3(0.42, 0.56, 0.85))
HORIZON = wp.constant(wp.vec3(0.95, 0.92, 0.88))
GROUND = wp.constant(wp.vec3(0.30, 0.25, 0.22))


@wp.func
def local(placements: wp.array2d[float], shape: int, point: wp.vec3) -> wp.vec3:
    """Return a point in the axes of a solid."""
    x = point[0] - placements[shape, 9]
    y = point[1] - placements[shape, 10]
    z = point[2] - placements[shape, 11]
    return wp.vec3(
        placements[shape, 0] * x + placements[shape, 1] * y + placements[shape, 2] * z,
        placements[shape, 3] * x + placements[shape, 4] * y + placements[shape, 5] * z,
        placements[shape, 6] * x + placements[shape, 7] * y + placements[shape, 8] * z,
    )


@wp.func
def speckle(p: wp.vec3) -> float:
    """Return a tone in [-1, 1) of a point of a solid: the mean of cubes of three sizes."""
    tone = float(0.0)
    cubes = float(FEWEST_CUBES)
    for level in range(3):
        x = int(wp.floor(p[0] * cubes))
        y = int(wp.floor(p[1] * cubes))
        z = int(wp.floor(p[2] * cubes))
        tone += random_unit(x, y, z, level) - 0.5
        cubes *= MORE_CUBES
    return tone * (1.0 / 1.5)


@wp.func
def distance_to(
    kinds: wp.array2d[int],
    placements: wp.array2d[float],
    sizes: wp.array2d[float],
    shape: int,
    point: wp.vec3,
) -> float:
    """Return the signed distance to a solid; for an ellipsoid a bound of it."""
    p = local(placements, shape, point)
    a = sizes[shape, 0]
    b = sizes[shape, 1]
    c = sizes[shape, 2]
    rounding = sizes[shape, 3]
    kind = kinds[shape, 0]
    if kind == Shape.ELLIPSOID:
        scaled = wp.vec3(p[0] / a, p[1] / b, p[2] / c)
        size = wp.length(scaled)
        slope = wp.length(wp.vec3(scaled[0] / a, scaled[1] / b, scaled[2] / c))
        return size * (size - 1.0) / wp.max(slope, 1.0e-6)
    if kind == Shape.TORUS:
        across = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - a
        return wp.sqrt(across * across + p[2] * p[2]) - b
    u = float(0.0)
    v = float(0.0)
    w = float(-1.0)
    if kind == Shape.BOX:
        u = wp.abs(p[0]) - a + rounding
        v = wp.abs(p[1]) - b + rounding
        w = wp.abs(p[2]) - c + rounding
    else:  # a cylinder
        u = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - a + rounding
        v = wp.abs(p[2]) - b + rounding
    outside = wp.length(wp.vec3(wp.max(u, 0.0), wp.max(v, 0.0), wp.max(w, 0.0)))
    inside = wp.max(u, v)
    if kind == Shape.BOX:
        inside = wp.max(inside, w)
    return outside + wp.min(inside, 0.0) - rounding


@wp.func
def distance(
    kinds: wp.array2d[int],
    placements: wp.array2d[float],
    sizes: wp.array2d[float],
    point: wp.vec3,
) -> float:
    """Return the distance to the nearest solid."""
    nearest = float(1.0e9)
    for shape in range(kinds.shape[0]):
        nearest = wp.min(nearest, distance_to(kinds, placements, sizes, shape, point))
    return nearest


@wp.func
def sky(direction: wp.vec3) -> wp.vec3:
    """Return the light from a direction, without the sun's."""
    if direction[2] < 0.0:
        return wp.lerp(HORIZON, GROUND, wp.min(-4.0 * direction[2], 1.0))
    return wp.lerp(HORIZON, ZENITH, wp.sqrt(direction[2]))


@wp.func
def shaded(
    kinds: wp.array2d[int],
    placements: wp.array2d[float],
    sizes: wp.array2d[float],
    paints: wp.array2d[float],
    sun: wp.vec3,
    shape: int,
    point: wp.vec3,
    view: wp.vec3,
) -> wp.vec3:
    """Return the colour of the surface of a solid, seen along `view`."""
    # The normal from the distances at four corners of a tetrahedron around the point.
    normal = wp.vec3()
    for k in range(4):
        corner = wp.vec3(1.0, 1.0, 1.0)
        if k < 3:
            corner = wp.vec3(-1.0, -1.0, -1.0)
            corner[k] = 1.0
        d = distance_to(kinds, placements, sizes, shape, point + 5.0e-4 * corner)
        normal += d * corner
    normal = wp.normalize(normal)
    start = point + 2.0e-3 * normal
    # The visible share of the sun, from the smallest gap over distance along the way to it.
    facing = wp.dot(normal, sun)
    light = float(0.0)
    if facing > 0.0:
        light += 1.0
        t = float(0.01)
        for _ in range(SHADOW_STEPS):
            if light > 0.01 and t < 2.0:
                gap = distance(kinds, placements, sizes, start + t * sun)
                light = wp.min(light, wp.max(SOFT * gap / t, 0.0))
                t += wp.clamp(gap, 0.02, 0.25)
        light = light * light * (3.0 - 2.0 * light)
    # The hidden share of the sky, from gaps along the normal that are narrower than their distance.
    hidden = float(0.0)
    weight = float(1.0)
    for k in range(4):
        up = 0.03 + 0.1 * float(k)
        gap = distance(kinds, placements, sizes, point + up * normal)
        hidden += weight * wp.max(up - gap, 0.0)
        weight *= 0.7
    open = wp.clamp(1.0 - 1.6 * hidden, 0.0, 1.0)
    # Paint.
    p = local(placements, shape, point)
    pattern = kinds[shape, 1]
    scale = paints[shape, 7]
    cell = float(0.0)
    if pattern == Pattern.CHECKS:
        cell = wp.floor(p[0] * scale) + wp.floor(p[1] * scale)
    elif pattern == Pattern.RINGS:
        cell = wp.floor(wp.sqrt(p[0] * p[0] + p[1] * p[1]) * scale)
    elif pattern == Pattern.STRIPES:
        cell = wp.floor(p[2] * scale)
    paint = wp.vec3(paints[shape, 0], paints[shape, 1], paints[shape, 2])
    if pattern != Pattern.PLAIN and cell - 2.0 * wp.floor(0.5 * cell) > 0.5:
        paint = wp.vec3(paints[shape, 3], paints[shape, 4], paints[shape, 5])
    if paints[shape, 8] > 0.0:
        paint *= 1.0 + paints[shape, 8] * speckle(p)
    gloss = paints[shape, 6]
    lit = light * wp.max(facing, 0.0) * SUN
    around = wp.lerp(GROUND, ZENITH, 0.5 + 0.5 * normal[2])
    color = 0.75 * wp.cw_mul(paint, lit + open * (0.9 * around + wp.vec3(0.12, 0.12, 0.12)))
    # Gloss reflects the sky by Fresnel's law [Schlick 1994], and a widened sun.
    cosine = wp.clamp(-wp.dot(normal, view), 0.0, 1.0)
    grazing = wp.pow(1.0 - cosine, 5.0)
    mirrored = view - 2.0 * wp.dot(view, normal) * normal
    color += gloss * (0.05 + 0.6 * grazing) * open * sky(mirrored)
    half = wp.normalize(sun - view)
    color += gloss * light * wp.pow(wp.max(wp.dot(normal, half), 0.0), 48.0) * 0.55 * SUN
    for k in range(3):
        color[k] = wp.pow(1.0 - wp.exp(-0.85 * color[k]), 1.0 / 2.2)
    return color


@wp.kernel
def trace_kernel(
    stride: int,
    first: int,
    last: int,
    origins: wp.array2d[float],  # (R, 3)
    directions: wp.array2d[float],  # (R, 3)
    solids: Solids,
    around: wp.array[float],  # (4,): a ball that has all solids in it
    sun: wp.array[float],  # (3,): unit vector to it
    # outputs
    colors: wp.array2d[float],  # (R, 4): with opacity
    depths: wp.array[float],  # (R,): 0 where nothing is hit
):
    """Follow each ray to the nearest solid."""
    for ray in range(first + wp.tid(), last, stride):
        origin = row(origins, ray)
        view = row(directions, ray)
        away = wp.vec3(around[0], around[1], around[2]) - origin
        middle = wp.dot(away, view)
        inside = around[3] * around[3] - wp.dot(away, away) + middle * middle
        hit = int(-1)
        t = float(0.0)
        if inside > 0.0:
            t = wp.max(middle - wp.sqrt(inside), 0.0)
            end = middle + wp.sqrt(inside)
            steps = int(0)
            while hit < 0 and t < end and steps < STEPS:
                nearest = float(1.0e9)
                which = int(0)
                for shape in range(solids.kinds.shape[0]):
                    d = distance_to(
                        solids.kinds, solids.placements, solids.sizes, shape, origin + t * view
                    )
                    if d < nearest:
                        nearest = d
                        which = shape
                if nearest < NEAR:
                    hit = which
                else:
                    t += nearest
                steps += 1
        color = wp.vec3()
        if hit >= 0:
            point = origin + t * view
            color = shaded(
                solids.kinds, solids.placements, solids.sizes, solids.paints,
                wp.vec3(sun[0], sun[1], sun[2]), hit, point, view,
            )  # fmt: skip
        for k in range(3):
            colors[ray, k] = color[k]
        colors[ray, 3] = wp.where(hit >= 0, 1.0, 0.0)
        depths[ray] = wp.where(hit >= 0, t, 0.0)


def trace(
    origins: wp.array,
    directions: wp.array,
    solids: codes.Solids,
    around: wp.array,
    sun: wp.array,
    colors: wp.array,
    depths: wp.array,
) -> None:
    """Find the colour, opacity and distance of the first surface that each ray hits.

    `origins` and unit `directions` are (R, 3). `around` (4,) is the middle and radius of a ball
    that contains all solids, `sun` (3,) a unit vector. `colors` (R, 4) and `depths` (R,) are
    filled, with 0 where nothing is hit.
    """
    count = origins.shape[0]
    launch_each(
        trace_kernel,
        count,
        4096 * count,
        [origins, directions, struct_of(Solids, solids), around, sun],
        [colors, depths],
    )
