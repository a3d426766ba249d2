"""The arguments of Adam as Warp structures; see the tuples in kernels/codes/radiance.py."""

import warp as wp


@wp.struct
class AdamRule:
    """The constants of a step of Adam."""

    beta1: float
    beta2: float
    epsilon: float
    decay: float
    sparse: bool


@wp.struct
class Learnt:
    """Parameters, with their gradients and Adam's moments; each (N,)."""

    gradients: wp.array[float]
    mean: wp.array[float]
    square: wp.array[float]
    weights: wp.array[float]
