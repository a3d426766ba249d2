"""Solids by their signed distances, traced and shaded, in Taichi; one thread per ray.

A ray advances by the distance to the nearest surface [Hart 1996, "Sphere tracing"]. A hit is lit by
a sun with soft shadows and by a sky; glossy paint reflects both.
"""

import numpy as np
import taichi as ti
import taichi.math as tm

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Pattern, Shape
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_unit
from cvkern.kernels.taichi.radiance._space import row

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)

STEPS = 96
FEWEST_CUBES, MORE_CUBES = codes.FEWEST_CUBES, codes.MORE_CUBES
NEAR = 1e-3  # distance at which a ray has hit a surface
SHADOW_STEPS = 32
SOFT = 14.0  # one over the tangent of half the sun's apparent size
SUN = (2.3, 2.1, 1.8)
ZENITH = (0.42, 0.56, 0.85)
HORIZON = (0.95, 0.92, 0.88)
GROUND = (0.30, 0.25, 0.22)
ELLIPSOID, BOX, TORUS = int(Shape.ELLIPSOID), int(Shape.BOX), int(Shape.TORUS)
PLAIN, CHECKS, RINGS = int(Pattern.PLAIN), int(Pattern.CHECKS), int(Pattern.RINGS)


@ti.func
def _local(placements: ti.template(), shape, point):
    """Return a point in the axes of a solid."""
    moved = point - tm.vec3(placements[shape, 9], placements[shape, 10], placements[shape, 11])
    found = tm.vec3(0.0)
    for k in ti.static(range(3)):
        axis = tm.vec3(
            placements[shape, 3 * k], placements[shape, 3 * k + 1], placements[shape, 3 * k + 2]
        )
        found[k] = tm.dot(axis, moved)
    return found


@ti.func
def _distance_to(
    kinds: ti.template(), placements: ti.template(), sizes: ti.template(), shape, point
):
    """Return the signed distance to a solid; for an ellipsoid a bound of it."""
    p = _local(placements, shape, point)
    size = tm.vec3(sizes[shape, 0], sizes[shape, 1], sizes[shape, 2])
    rounding = sizes[shape, 3]
    kind = kinds[shape, 0]
    found = 0.0
    if kind == ELLIPSOID:
        scaled = p / size
        length = tm.length(scaled)
        found = length * (length - 1.0) / ti.max(tm.length(scaled / size), 1e-6)
    elif kind == TORUS:
        across = tm.length(p.xy) - size[0]
        found = tm.length(tm.vec2(across, p.z)) - size[1]
    else:
        q = tm.vec3(tm.length(p.xy) - size[0] + rounding, ti.abs(p.z) - size[1] + rounding, -1.0)
        if kind == BOX:
            q = ti.abs(p) - size + rounding
        inside = ti.max(q[0], q[1])
        if kind == BOX:
            inside = ti.max(inside, q[2])
        found = tm.length(ti.max(q, 0.0)) + ti.min(inside, 0.0) - rounding
    return found


@ti.func
def _distance(kinds: ti.template(), placements: ti.template(), sizes: ti.template(), point):
    """Return the distance to the nearest solid."""
    nearest = 1e9
    for shape in range(kinds.shape[0]):
        nearest = ti.min(nearest, _distance_to(kinds, placements, sizes, shape, point))
    return nearest


@ti.func
def _sky(direction):
    """Return the light from a direction, without the sun's."""
    down = tm.mix(tm.vec3(HORIZON), tm.vec3(GROUND), ti.min(-4.0 * direction.z, 1.0))
    up = tm.mix(tm.vec3(HORIZON), tm.vec3(ZENITH), ti.sqrt(ti.max(direction.z, 0.0)))
    return down if direction.z < 0.0 else up


@ti.func
def _sunlight(kinds: ti.template(), placements: ti.template(), sizes: ti.template(), sun, start):
    """Return the visible share of the sun, from the smallest gap over distance along the way."""
    light = 1.0
    t = 0.01
    for _ in range(SHADOW_STEPS):
        if light > 0.01 and t < 2.0:
            gap = _distance(kinds, placements, sizes, start + t * sun)
            light = ti.min(light, ti.max(SOFT * gap / t, 0.0))
            t += tm.clamp(gap, 0.02, 0.25)
    return light * light * (3.0 - 2.0 * light)


@ti.func
def _speckle(p):
    """Return a tone in [-1, 1) of a point of a solid: the mean of cubes of three sizes."""
    tone = 0.0
    cubes = FEWEST_CUBES
    for level in range(3):
        cell = ti.cast(ti.floor(p * cubes), ti.i32)
        tone += random_unit(cell.x, cell.y, cell.z, level) - 0.5
        cubes *= MORE_CUBES
    return tone * (1.0 / 1.5)


@ti.func
def _paint(kinds: ti.template(), placements: ti.template(), paints: ti.template(), shape, point):
    """Return the colour of the paint at a point of a solid."""
    p = _local(placements, shape, point)
    pattern, scale = kinds[shape, 1], paints[shape, 7]
    cell = ti.floor(p.z * scale)
    if pattern == CHECKS:
        cell = ti.floor(p.x * scale) + ti.floor(p.y * scale)
    elif pattern == RINGS:
        cell = ti.floor(tm.length(p.xy) * scale)
    second = pattern != PLAIN and cell - 2.0 * ti.floor(0.5 * cell) > 0.5
    at = 3 if second else 0
    paint = tm.vec3(paints[shape, at], paints[shape, at + 1], paints[shape, at + 2])
    if paints[shape, 8] > 0.0:
        paint *= 1.0 + paints[shape, 8] * _speckle(p)
    return paint


@ti.func
def _shaded(
    kinds: ti.template(),
    placements: ti.template(),
    sizes: ti.template(),
    paints: ti.template(),
    sun,
    shape,
    point,
    view,
):
    """Return the colour of the surface of a solid, seen along `view`."""
    # The normal from the distances at four corners of a tetrahedron around the point.
    normal = tm.vec3(0.0)
    for k in ti.static(range(4)):
        corner = tm.vec3(1.0)
        if ti.static(k < 3):
            corner = tm.vec3(-1.0)
            corner[k] = 1.0
        normal += corner * _distance_to(kinds, placements, sizes, shape, point + 5e-4 * corner)
    normal = tm.normalize(normal)
    facing = tm.dot(normal, sun)
    light = 0.0
    if facing > 0.0:
        light = _sunlight(kinds, placements, sizes, sun, point + 2e-3 * normal)
    # The hidden share of the sky, from gaps along the normal that are narrower than their distance.
    hidden = 0.0
    for k in ti.static(range(4)):
        up = 0.03 + 0.1 * k
        gap = _distance(kinds, placements, sizes, point + up * normal)
        hidden += 0.7**k * ti.max(up - gap, 0.0)
    open = tm.clamp(1.0 - 1.6 * hidden, 0.0, 1.0)
    gloss = paints[shape, 6]
    lit = light * ti.max(facing, 0.0) * tm.vec3(SUN)
    around = tm.mix(tm.vec3(GROUND), tm.vec3(ZENITH), 0.5 + 0.5 * normal.z)
    paint = _paint(kinds, placements, paints, shape, point)
    color = 0.75 * paint * (lit + open * (0.9 * around + 0.12))
    # Gloss reflects the sky by Fresnel's law [Schlick 1994], and a widened sun.
    grazing = (1.0 - tm.clamp(-tm.dot(normal, view), 0.0, 1.0)) ** 5
    mirrored = view - 2.0 * tm.dot(view, normal) * normal
    color += gloss * (0.05 + 0.6 * grazing) * open * _sky(mirrored)
    half = tm.normalize(sun - view)
    color += gloss * light * ti.max(tm.dot(normal, half), 0.0) ** 48 * 0.55 * tm.vec3(SUN)
    return (1.0 - ti.exp(-0.85 * color)) ** (1.0 / 2.2)


@ti.kernel
def _trace(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    kinds: i32_2,  # (S, 2): Shape, Pattern
    placements: f32_2,  # (S, 12): the axes, each a row, and the middle
    sizes: f32_2,  # (S, 4): see Shape
    paints: f32_2,  # (S, 9): two colours, gloss, parts of the pattern per length, speckles
    around: f32_1,  # (4,): a ball that has all solids in it
    sun: f32_1,  # (3,): unit vector to it
    # outputs
    colors: f32_2,  # (R, 4): with opacity
    depths: f32_1,  # (R,): 0 where nothing is hit
):
    for ray in depths:
        origin = row(origins, ray)
        view = row(directions, ray)
        away = tm.vec3(around[0], around[1], around[2]) - origin
        middle = tm.dot(away, view)
        inside = around[3] * around[3] - tm.dot(away, away) + middle * middle
        hit = -1
        t = 0.0
        if inside > 0.0:
            t = ti.max(middle - ti.sqrt(inside), 0.0)
            end = middle + ti.sqrt(inside)
            steps = 0
            while hit < 0 and t < end and steps < STEPS:
                nearest = 1e9
                which = 0
                for shape in range(kinds.shape[0]):
                    d = _distance_to(kinds, placements, sizes, shape, origin + t * view)
                    if d < nearest:
                        nearest = d
                        which = shape
                if nearest < NEAR:
                    hit = which
                else:
                    t += nearest
                steps += 1
        color = tm.vec3(0.0)
        if hit >= 0:
            light = tm.vec3(sun[0], sun[1], sun[2])
            point = origin + t * view
            color = _shaded(kinds, placements, sizes, paints, light, hit, point, view)
        for k in ti.static(range(3)):
            colors[ray, k] = color[k]
        colors[ray, 3] = 1.0 if hit >= 0 else 0.0
        depths[ray] = t if hit >= 0 else 0.0


@primitive
def trace(
    origins: np.ndarray,
    directions: np.ndarray,
    solids: codes.Solids,
    around: np.ndarray,
    sun: np.ndarray,
    colors: np.ndarray,
    depths: np.ndarray,
) -> None:
    """Find the colour, opacity and distance of the first surface that each ray hits.

    `origins` and unit `directions` are (R, 3). `around` (4,) is the middle and radius of a ball
    that contains all solids, `sun` (3,) a unit vector. `colors` (R, 4) and `depths` (R,) are
    filled, with 0 where nothing is hit.
    """
    _trace(origins, directions, *solids, around, sun, colors, depths)
