"""What all rays have in common on their way through a grid of density and colour."""

from typing import Any

import warp as wp

from cvkern.kernels.warp._random import random_unit

wp.set_module_options({"enable_backward": False})


@wp.struct
class March:
    """Arguments of `radiance_voxel.render`, from `bits` on in their order."""

    bits: wp.array[wp.uint32]  # (cells^3 / 32,)
    cells: int
    near: float
    far: float
    finest: float
    cone: float
    unbounded: bool
    jittered: bool
    seed: int
    step: wp.array[int]  # (1,)
    stop: float
    least: float
    basis: int
    density: wp.array3d[float]  # (N + 1, N + 1, N + 1)
    color: wp.array4d[float]  # (N + 1, N + 1, N + 1, C)


# In native code: what `march` has, by the names of its fields.
NAMES = f"const auto [{', '.join(March.vars)}] = march;"


def march_of(*arguments: Any) -> March:
    """Return the march of these arguments, in the order of its fields."""
    march = March()
    for name, value in zip(March.vars, arguments, strict=True):
        setattr(march, name, value)
    return march


@wp.func
def jitter_of(march: March, ray: int) -> float:
    """Return how far behind its entry the first place of a ray is, in steps."""
    if march.jittered:
        return random_unit(march.seed, march.step[0], ray, 4)
    return 0.5
