"""Rays through a grid of density and colour: marched, read and composited at once, in Taichi.

One thread a ray. The grid has N + 1 nodes (k, j, i) along each side, at z, y, x = -1 .. 1, or in
all of space, contracted, at -2 .. 2. Between them its numbers are interpolated linearly: a raw
density r, with density e^r, or 0 where r is at most `least`, and for each channel the coefficients
of spherical harmonics of the direction, whose sum s is made a colour 1 / (1 + e^-s). The density is
cut off at e^11, but its gradient is not made 0 there. With w_i, T_i, G_i as in
radiance/compositing.py:

    dL/dr_i = sigma_i d_i (T_{i+1} G_i - sum_{j > i} w_j G_j) where r_i > least, else 0,
    dL/ds_i = w_i dL/dC c_i (1 - c_i),    at a node: dL/dr = sum_i b_i dL/dr_i,
    and of a coefficient sum_i b_i Y dL/ds_i, with b_i the node's share in sample i, Y the harmonic.

The backward pass walks again. What it needs of the samples behind i is what the forward pass
returned, less what has been passed: sum_j w_j G_j is linear in that.
"""

import numpy as np

from cvkern.kernels.taichi._launch import on_cpu, primitive, scratch

from ._march import march


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
