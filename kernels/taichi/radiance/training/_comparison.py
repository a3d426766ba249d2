"""What rays are compared with: backgrounds, and errors of channels, for every loss."""

import taichi as ti

from cvkern.kernels.codes.radiance import Background, Draw
from cvkern.kernels.taichi._random import random_unit

vec3 = ti.types.vector(3, ti.f32)


@ti.func
def background_of(
    comparison: ti.template(), learnt: ti.template(), step: ti.i32, ray: ti.i32
) -> vec3:
    """Return the background of a ray."""
    kind, seed = comparison.kind, comparison.seed
    color = vec3(0.0)
    if kind == Background.WHITE:
        color = vec3(1.0)
    elif kind == Background.RANDOM:
        for k in ti.static(range(3)):
            color[k] = random_unit(seed, step, ray, Draw.RED + k)
    elif kind == Background.LEARNT:
        color = vec3(learnt[0], learnt[1], learnt[2])
    return color


@ti.func
def error_of(error: ti.f32, target: ti.f32, seen: ti.f32, comparison: ti.template()) -> ti.f32:
    """Return the error of a channel, 0 beyond the end of the range that its photograph has."""
    clipped = (target >= 1.0 and error > 0.0) or (target <= 0.0 and error < 0.0)
    return 0.0 if comparison.censored and seen >= 1.0 and clipped else error
