"""The step of Adam for one number [Kingma and Ba 2015], in Taichi."""

import taichi as ti


@ti.func
def adam_step(
    g: ti.f32,
    mean: ti.f32,
    square: ti.f32,
    weight: ti.f32,
    rate: ti.template(),
    beta1: ti.f32,
    beta2: ti.f32,
    epsilon: ti.f32,
):
    """Return mean, mean of squares and weight after a step with gradient g.

    `rate` (3,) holds the learning rate, and the divisors of the two means.
    """
    m = beta1 * mean + (1.0 - beta1) * g
    v = beta2 * square + (1.0 - beta2) * g * g
    return m, v, weight - rate[0] / rate[1] * m / (ti.sqrt(v / rate[2]) + epsilon)
