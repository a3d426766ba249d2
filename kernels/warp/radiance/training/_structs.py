"""What Adam is given, as Warp structures: see the tuples in kernels/codes/radiance.py."""

import warp as wp


@wp.struct
class Rule:
    """How Adam steps."""

    beta1: float
    beta2: float
    epsilon: float
    decay: float
    sparse: bool


@wp.struct
class Learnt:
    """Numbers that are learnt, with what Adam keeps of their gradients; each (N,)."""

    gradients: wp.array[float]
    mean: wp.array[float]
    square: wp.array[float]
    weights: wp.array[float]
