"""Steps over all nodes of a grid of density and colour, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.radiance.training._adam_step import adam_step

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
u32_1 = ti.types.ndarray(dtype=ti.u32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)


@ti.kernel
def _total_variation(
    weight_density: ti.f32,
    weight_color: ti.f32,
    touched: u8_3,
    density: f32_3,
    color: f32_4,
    # outputs
    d_density: f32_3,
    d_color: f32_4,
):
    for k, j, i in touched:
        if touched[k, j, i]:
            node = ti.Vector([k, j, i])
            for axis, sign in ti.static(ti.ndrange(3, 2)):
                other = node + (2 * sign - 1) * ti.Vector.unit(3, axis, ti.i32)
                if 0 <= other[axis] < density.shape[axis]:
                    d_density[node] += weight_density * (density[node] - density[other])
                    for c in range(color.shape[3]):
                        difference = color[k, j, i, c] - color[other[0], other[1], other[2], c]
                        d_color[k, j, i, c] += weight_color * difference


@ti.kernel
def _adam_density(
    rate: f32_1,  # (3,)
    factor: f32_1,  # (1,)
    rule: vec3,  # beta1, beta2, epsilon
    touched: u8_3,
    # outputs
    d_density: f32_3,
    mean: f32_3,
    square: f32_3,
    density: f32_3,
):
    for node in ti.grouped(touched):
        if touched[node]:
            g = d_density[node] * factor[0]
            d_density[node] = 0.0
            mean[node], square[node], density[node] = adam_step(
                g, mean[node], square[node], density[node], rate, rule[0], rule[1], rule[2]
            )


@ti.kernel
def _adam_color(
    rate: f32_1,  # (3,)
    factor: f32_1,  # (1,)
    rule: vec3,  # beta1, beta2, epsilon
    # outputs
    touched: u8_3,
    d_color: f32_4,
    mean: f32_4,
    square: f32_4,
    color: f32_4,
):
    for k, j, i in touched:
        if touched[k, j, i]:
            touched[k, j, i] = ti.u8(0)
            for c in range(color.shape[3]):
                at = ti.Vector([k, j, i, c])
                g = d_color[at] * factor[0]
                d_color[at] = 0.0
                mean[at], square[at], color[at] = adam_step(
                    g, mean[at], square[at], color[at], rate, rule[0], rule[1], rule[2]
                )


@ti.kernel
def _mark(
    density: f32_3,
    cells: ti.i32,
    least: ti.f32,
    # outputs
    bits: u32_1,
):
    size = (density.shape[0] - 1) // cells
    for word in bits:
        found = ti.u32(0)
        for bit in range(32):
            cell = 32 * word + bit
            x, y, z = cell % cells * size, cell // cells % cells * size, cell // cells**2 * size
            most = -1e30
            for k, j, i in ti.ndrange(size + 1, size + 1, size + 1):
                most = ti.max(most, density[z + k, y + j, x + i])
            if most > least:
                found |= ti.u32(1) << ti.cast(bit, ti.u32)
        bits[word] = found


@ti.kernel
def _upsample(
    density: f32_3,
    least: ti.f32,
    coarse: f32_4,
    # outputs
    fine: f32_4,
):
    side, most = fine.shape[0] - 1, coarse.shape[0] - 1
    for z, y, x in ti.ndrange(side + 1, side + 1, side + 1):
        fine_node = ti.Vector([x, y, z])
        # In units of coarse nodes it is at fine_node most / side; interpolate the nodes around it.
        first = ti.max((fine_node * most + side - 1) // side - 1, 0)
        last = ti.min(fine_node * most // side, most - 1) + 2
        wanted = False
        for k, j, i in ti.ndrange((first[2], last[2]), (first[1], last[1]), (first[0], last[0])):
            wanted = wanted or density[k, j, i] > least
        if wanted:
            for c in range(fine.shape[3]):
                total = 0.0
                for k, j, i in ti.ndrange(
                    (first[2], last[2]), (first[1], last[1]), (first[0], last[0])
                ):
                    apart = ti.abs(fine_node * most - ti.Vector([i, j, k]) * side) / side
                    share = ti.max(1.0 - apart, 0.0)
                    total += share[0] * share[1] * share[2] * coarse[k, j, i, c]
                fine[z, y, x, c] = total


@primitive
def total_variation(
    weight_density: float,
    weight_color: float,
    touched: np.ndarray,
    density: np.ndarray,
    color: np.ndarray,
    d_density: np.ndarray,
    d_color: np.ndarray,
) -> None:
    """Add, at touched nodes, the gradients of `weight / 2` times squared differences.

    The differences are those from the six neighbours of a node; each pair counts once. `touched`,
    `density` and `d_density` are (N, N, N), `color` and `d_color` (N, N, N, C).
    """
    _total_variation(weight_density, weight_color, touched, density, color, d_density, d_color)


@primitive
def adam(
    rate_density: np.ndarray,
    rate_color: np.ndarray,
    factor: np.ndarray,
    rule: codes.AdamRule,
    touched: np.ndarray,
    density: codes.Learnt,
    color: codes.Learnt,
) -> None:
    """Take a step of Adam at touched nodes; afterwards no node is touched, and gradients are 0.

    Gradients are first multiplied by `factor` (1,). `rate_density` and `rate_color` (3,) are those
    of `training.adam.learning_rate` for the same step. `touched` and the arrays of `density` are
    (N, N, N), those of `color` (N, N, N, C). The rule's decay is 0, and it is not sparse.
    """
    numbers = ti.Vector([rule.beta1, rule.beta2, rule.epsilon])
    _adam_density(rate_density, factor, numbers, touched, *density)
    _adam_color(rate_color, factor, numbers, touched, *color)


@primitive
def mark(density: np.ndarray, cells: int, least: float, bits: np.ndarray) -> None:
    """Set the bits of cells that have a node, inside or on a side, of a raw density above `least`.

    `density` has (N + 1, N + 1, N + 1) nodes, `bits` (cells^3 / 32,) words with the first cell in
    the lowest bit; N is a multiple of `cells`.
    """
    _mark(density, cells, least, bits)


@primitive
def upsample(density: np.ndarray, least: float, coarse: np.ndarray, fine: np.ndarray) -> None:
    """Interpolate a grid, `coarse` (N, N, N, C), at the nodes of a `fine` one, (F, F, F, C).

    `fine` is 0 before. A node is written only if one of its coarse cells has a node of a raw
    density above `least`; `density` (N, N, N) holds the raw densities.
    """
    _upsample(density, least, coarse, fine)
