"""The begin of the samples of a ray through a grid of density and colour."""

import warp as wp

from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp.radiance._structs import March

JITTER = wp.constant(int(Draw.JITTER))


@wp.func
def jitter_of(march: March, ray: int) -> float:
    """Return the distance of a ray's first position from its entry, in steps."""
    if march.jittered:
        return random_unit(march.seed, march.step[0], ray, JITTER)
    return 0.5
