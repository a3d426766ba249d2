"""Parameters of texels, their values, and their steps of Adam, in Warp.

A texel has the parameters (r, s): its colours and its opacity are logistic functions,
c = 1 / (1 + e^-r) and a = 1 / (1 + e^-s), and its value is (a c, a). From gradients (G, g) by the
value,

    dL/dr = a G c (1 - c),    dL/ds = a (1 - a) (<G, c> + g).
"""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import launch_each, view
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance.training._structs import AdamRule

wp.set_module_options({"enable_backward": False})


@wp.func
def value_of(p: wp.vec4) -> wp.vec4:
    """Return the value of a texel with these parameters."""
    opacity = 1.0 / (1.0 + wp.exp(-p[3]))
    return wp.vec4(
        opacity / (1.0 + wp.exp(-p[0])),
        opacity / (1.0 + wp.exp(-p[1])),
        opacity / (1.0 + wp.exp(-p[2])),
        opacity,
    )


@wp.kernel
def values_kernel(
    stride: int,
    first: int,
    last: int,
    parameters: wp.array[wp.vec4],  # (N,)
    # outputs
    values: wp.array[wp.vec4],  # (N,)
):
    """Compute the value of a texel."""
    for i in range(first + wp.tid(), last, stride):
        values[i] = value_of(parameters[i])


def values(parameters: wp.array, found: wp.array) -> None:
    """Compute the values (D, H, W, 4) of texels from their parameters of the same shape."""
    parameters, found = _flat(parameters), _flat(found)
    count = parameters.shape[0]
    launch_each(values_kernel, count, 16 * count, [parameters], [found])


@wp.kernel
def learn_kernel(
    stride: int,
    first: int,
    last: int,
    rate: wp.array[float],  # (3,)
    factor: wp.array[float],  # (1,)
    rule: AdamRule,
    # outputs
    gradients: wp.array[wp.vec4],  # (N,): set to 0
    mean: wp.array[wp.vec4],  # (N,)
    square: wp.array[wp.vec4],  # (N,)
    parameters: wp.array[wp.vec4],  # (N,)
    values: wp.array[wp.vec4],  # (N,)
):
    """Take a step for a texel that has a gradient."""
    learning = rate[0] / rate[1]
    for i in range(first + wp.tid(), last, stride):
        g = gradients[i]
        if g[0] != 0.0 or g[1] != 0.0 or g[2] != 0.0 or g[3] != 0.0:
            gradients[i] = wp.vec4(0.0, 0.0, 0.0, 0.0)
            g = factor[0] * g
            p = parameters[i]
            m = mean[i]
            v = square[i]
            a = values[i][3]
            total = g[3]
            slope = wp.vec4(0.0, 0.0, 0.0, 0.0)
            for k in range(3):
                c = 1.0 / (1.0 + wp.exp(-p[k]))
                slope[k] = a * g[k] * c * (1.0 - c)
                total += g[k] * c
            slope[3] = a * (1.0 - a) * total
            for k in range(4):
                m[k] = rule.beta1 * m[k] + (1.0 - rule.beta1) * slope[k]
                v[k] = rule.beta2 * v[k] + (1.0 - rule.beta2) * slope[k] * slope[k]
                p[k] = p[k] - learning * m[k] / (wp.sqrt(v[k] / rate[2]) + rule.epsilon)
            mean[i] = m
            square[i] = v
            parameters[i] = p
            values[i] = value_of(p)


def learn(
    rate: wp.array,
    factor: wp.array,
    rule: codes.AdamRule,
    learnt: codes.Learnt,
    values: wp.array,
) -> None:
    """Take a step of Adam for texels with gradients by their `values`, times `factor` (1,).

    All arrays are (D, H, W, 4). `rate` (3,) is that of `training.adam.learning_rate`. The gradients
    are reset to 0, and the values computed again. A texel whose gradients are all 0 keeps its
    moments, as if `rule` were sparse; there is no weight decay.
    """
    arrays = [_flat(a) for a in (*learnt, values)]
    count = arrays[0].shape[0]
    launch_each(learn_kernel, count, 4 * count, [rate, factor, struct_of(AdamRule, rule)], arrays)


def _flat(array: wp.array) -> wp.array:
    """View an array (D, H, W, 4) as (D H W,) vectors."""
    return view(array, wp.vec4, (array.size // 4,))
