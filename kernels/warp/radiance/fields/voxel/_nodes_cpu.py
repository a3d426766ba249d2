"""Steps over the whole grid of density and colour on the CPU: one thread per slab of planes.

nodes.py says what is computed. Only nodes that rays have touched are processed.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.warp.radiance.training._structs import AdamRule, Learnt

wp.set_module_options({"enable_backward": False})


class Kernels(NamedTuple):
    """The kernels for rows of one width."""

    row: Any
    """A vector of this width."""
    learnt: Any
    """The structure of learnt rows."""
    adam: wp.Kernel
    total_variation: wp.Kernel


@cache
def kernels(width: int) -> Kernels:
    """Return the kernels for rows of `width` colour coefficients."""
    row = wp.types.vector(width, wp.float32)
    size = wp.constant(width)

    @wp.struct
    class Rows:
        """Colour coefficients as `Learnt`, a row a node; each (N^3,)."""

        gradients: wp.array[row]
        mean: wp.array[row]
        square: wp.array[row]
        weights: wp.array[row]

    @wp.kernel
    def adam(
        slab: int,
        first: int,
        last: int,
        side: int,
        rate_density: wp.array[float],  # (3,)
        rate_color: wp.array[float],  # (3,)
        factor: wp.array[float],  # (1,)
        rule: AdamRule,
        # outputs
        touched: wp.array[wp.uint8],  # (N^3,): set to 0
        density: Learnt,  # (N^3,)
        color: Rows,
    ):
        """Take a step of Adam at the touched nodes of planes."""
        # Both means of squares have the same age.
        mend = 1.0 / rate_color[2]
        of_density = rate_density[0] / rate_density[1]
        of_color = rate_color[0] / rate_color[1]
        for node in range(first * side * side, last * side * side):
            if touched[node] != wp.uint8(0):
                touched[node] = wp.uint8(0)
                g = density.gradients[node] * factor[0]
                m = rule.beta1 * density.mean[node] + (1.0 - rule.beta1) * g
                v = rule.beta2 * density.square[node] + (1.0 - rule.beta2) * g * g
                change = of_density * m / (wp.sqrt(v * mend) + rule.epsilon)
                density.mean[node] = m
                density.square[node] = v
                density.weights[node] = density.weights[node] - change
                density.gradients[node] = 0.0
                gs = color.gradients[node] * factor[0]
                ms = rule.beta1 * color.mean[node] + (1.0 - rule.beta1) * gs
                vs = rule.beta2 * color.square[node] + (1.0 - rule.beta2) * wp.cw_mul(gs, gs)
                roots = row()
                for c in range(size):
                    roots[c] = wp.sqrt(vs[c] * mend) + rule.epsilon
                color.mean[node] = ms
                color.square[node] = vs
                color.weights[node] = color.weights[node] - of_color * wp.cw_div(ms, roots)
                color.gradients[node] = row()

    @wp.kernel
    def variation(
        slab: int,
        first: int,
        last: int,
        weight_density: float,
        weight_color: float,
        side: int,
        touched: wp.array[wp.uint8],  # (N^3,)
        density: wp.array[float],  # (N^3,)
        color: wp.array[row],  # (N^3,)
        # outputs
        d_density: wp.array[float],  # (N^3,): added to
        d_color: wp.array[row],  # (N^3,): added to
    ):
        """Add the gradients of squares of differences at the touched nodes of planes."""
        for node in range(first * side * side, last * side * side):
            if touched[node] != wp.uint8(0):
                i = node % side
                j = node // side % side
                k = node // (side * side)
                # A neighbour outside the grid counts as equal.
                a = node + wp.where(i > 0, -1, 0)
                b = node + wp.where(i + 1 < side, 1, 0)
                c = node + wp.where(j > 0, -side, 0)
                d = node + wp.where(j + 1 < side, side, 0)
                e = node + wp.where(k > 0, -side * side, 0)
                f = node + wp.where(k + 1 < side, side * side, 0)
                total = 6.0 * density[node] - density[a] - density[b] - density[c]
                total = total - density[d] - density[e] - density[f]
                d_density[node] = d_density[node] + weight_density * total
                around = (color[a] + color[b]) + (color[c] + color[d]) + (color[e] + color[f])
                change = weight_color * (6.0 * color[node] - around)
                d_color[node] = d_color[node] + change

    return Kernels(row, Rows, adam, variation)
