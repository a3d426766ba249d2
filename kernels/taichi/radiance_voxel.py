"""Rays through a grid of density and colour: marched, read and composited at once, in Taichi.

One thread a ray. The grid has N + 1 nodes (k, j, i) along each side, at z, y, x = -1 .. 1, or in
all of space, contracted, at -2 .. 2. Between them its numbers are interpolated linearly: a raw
density r, with density e^r, or 0 where r is at most `least`, and for each channel the coefficients
of spherical harmonics of the direction, whose sum s is made a colour 1 / (1 + e^-s). The density is
cut off at e^11, but its gradient is not made 0 there. With w_i, T_i, G_i as in
radiance_composite.py:

    dL/dr_i = sigma_i d_i (T_{i+1} G_i - sum_{j > i} w_j G_j) where r_i > least, else 0,
    dL/ds_i = w_i dL/dC c_i (1 - c_i),    at a node: dL/dr = sum_i b_i dL/dr_i,
    and of a coefficient sum_i b_i Y dL/ds_i, with b_i the node's share in sample i, Y the harmonic.

The backward pass walks again. What it needs of the samples behind i is what the forward pass
returned, less what has been passed: sum_j w_j G_j is linear in that.
"""

import numpy as np
import taichi as ti

from ._adam import adam_step
from ._launch import on_cpu, primitive, scratch
from ._radiance_voxel_march import march

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
u32_1 = ti.types.ndarray(dtype=ti.u32, ndim=1)


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
def _adam(
    rate_density: f32_1,
    rate_color: f32_1,
    factor: f32_1,
    beta1: ti.f32,
    beta2: ti.f32,
    epsilon: ti.f32,
    # outputs
    touched: u8_3,
    d_density: f32_3,
    density_mean: f32_3,
    density_square: f32_3,
    density: f32_3,
    d_color: f32_4,
    color_mean: f32_4,
    color_square: f32_4,
    color: f32_4,
):
    for k, j, i in touched:
        if touched[k, j, i]:
            touched[k, j, i] = ti.u8(0)
            g = d_density[k, j, i] * factor[0]
            d_density[k, j, i] = 0.0
            density_mean[k, j, i], density_square[k, j, i], density[k, j, i] = adam_step(
                g, density_mean[k, j, i], density_square[k, j, i], density[k, j, i], rate_density,
                beta1, beta2, epsilon,
            )  # fmt: skip
            for c in range(color.shape[3]):
                g = d_color[k, j, i, c] * factor[0]
                d_color[k, j, i, c] = 0.0
                color_mean[k, j, i, c], color_square[k, j, i, c], color[k, j, i, c] = adam_step(
                    g, color_mean[k, j, i, c], color_square[k, j, i, c], color[k, j, i, c],
                    rate_color, beta1, beta2, epsilon,
                )  # fmt: skip


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
        # Its place among the coarse nodes is fine_node most / side: those of the cells it is in.
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
def render(
    origins: np.ndarray,
    directions: np.ndarray,
    active: np.ndarray,
    bits: np.ndarray,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    unbounded: bool,
    jittered: bool,
    seed: int,
    step: np.ndarray,
    stop: float,
    least: float,
    basis: int,
    density: np.ndarray,
    color: np.ndarray,
    colors: np.ndarray,
    opacity: np.ndarray,
    depth: np.ndarray,
    distortion: np.ndarray,
    samples: np.ndarray,
) -> None:
    """Make out what the first `active` (1,) rays see, and how many samples had any density.

    `origins` and unit `directions` (R, 3), `near` to `jittered`, `seed` and `step` (1,) are as in
    `radiance_march.march_rays`, but `cone` is 0 unless `unbounded`; `bits` has one level of
    cells^3, each a power of 2 of the grid's cells along a side. A ray ends where no more than
    `stop` of the light is left. `density` (N + 1, N + 1, N + 1) has raw densities, `color`
    (N + 1, N + 1, N + 1, C), of C = 16 or 32, the `basis` (1, 4 or 9) coefficients of each channel
    in turn. `colors` (R, 3), `opacity`, `depth` and `distortion` (R,) are filled as by
    `radiance_composite.forward`, and `samples` (R,) with the numbers of samples, 0 for the other
    rays.
    """
    rendered = colors, opacity, depth, distortion
    # The gradients are not looked at.
    march(
        False, False, False, *rendered, origins, directions, active, bits, cells, near, far, finest,
        cone, unbounded, jittered, seed, step, stop, least, basis, density, color, *rendered,
        samples, density, color, scratch((1, 1, 1), np.uint8),
    )  # fmt: skip


@primitive
def render_backward(
    d_colors: np.ndarray,
    d_opacity: np.ndarray,
    d_depth: np.ndarray,
    d_distortion: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    active: np.ndarray,
    bits: np.ndarray,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    unbounded: bool,
    jittered: bool,
    seed: int,
    step: np.ndarray,
    stop: float,
    least: float,
    basis: int,
    density: np.ndarray,
    color: np.ndarray,
    colors: np.ndarray,
    opacity: np.ndarray,
    depth: np.ndarray,
    distortion: np.ndarray,
    samples: np.ndarray,
    d_density: np.ndarray,
    d_color: np.ndarray,
    touched: np.ndarray,
) -> None:
    """Add the gradients of the grid, and mark its nodes that have any.

    `d_colors` (R, 3), `d_opacity`, `d_depth` and `d_distortion` (R,) are those of what
    :func:`render` made of the same rays, `colors` to `samples`. `d_density` and `d_color` have the
    shapes of the grid, as has `touched` (N + 1, N + 1, N + 1), which is set to 1 at such nodes. On
    CUDA `d_density` and `d_color` may be int64, of fixed-point numbers: their sums are the same in
    any order. On the CPU one thread does all rays in turn: the sums do not change from run to run.
    """
    march(
        True, on_cpu(), d_color.dtype == np.int64, d_colors, d_opacity, d_depth, d_distortion,
        origins, directions, active, bits, cells, near, far, finest, cone, unbounded, jittered,
        seed, step, stop, least, basis, density, color, colors, opacity, depth, distortion, samples,
        d_density, d_color, touched,
    )  # fmt: skip


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
    """At touched nodes, add the gradients of `weight / 2` times the squares of differences.

    Those are the differences from the six neighbours of a node, each pair counted once. `touched`,
    `density` and `d_density` are (N, N, N), `color` and `d_color` (N, N, N, C).
    """
    _total_variation(weight_density, weight_color, touched, density, color, d_density, d_color)


@primitive
def adam(
    rate_density: np.ndarray,
    rate_color: np.ndarray,
    factor: np.ndarray,
    beta1: float,
    beta2: float,
    epsilon: float,
    touched: np.ndarray,
    d_density: np.ndarray,
    density_mean: np.ndarray,
    density_square: np.ndarray,
    density: np.ndarray,
    d_color: np.ndarray,
    color_mean: np.ndarray,
    color_square: np.ndarray,
    color: np.ndarray,
) -> None:
    """One step of Adam at touched nodes, which it leaves untouched, with gradients of 0.

    Before, these are multiplied by `factor` (1,). `rate_density` and `rate_color` (3,) are those of
    `radiance_adam.learning_rate` for the same step. What is of density, and `touched`, is
    (N, N, N), what is of colour (N, N, N, C).
    """
    _adam(
        rate_density, rate_color, factor, beta1, beta2, epsilon, touched, d_density, density_mean,
        density_square, density, d_color, color_mean, color_square, color,
    )  # fmt: skip


@primitive
def mark(density: np.ndarray, cells: int, least: float, bits: np.ndarray) -> None:
    """Set the bits of cells with a node of a raw density above `least`, in them or on their sides.

    `density` has (N + 1, N + 1, N + 1) nodes, `bits` (cells^3 / 32,) words with the first cell in
    the lowest bit; N is a multiple of `cells`.
    """
    _mark(density, cells, least, bits)


@primitive
def upsample(density: np.ndarray, least: float, coarse: np.ndarray, fine: np.ndarray) -> None:
    """Interpolate a grid, `coarse` (N, N, N, C), at the nodes of a `fine` one, (F, F, F, C).

    `fine` comes as zeros, and nodes that are in no coarse cell with a node of a raw density above
    `least` are not written; `density` (N, N, N) has those.
    """
    _upsample(density, least, coarse, fine)
