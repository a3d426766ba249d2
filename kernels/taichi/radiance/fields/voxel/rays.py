"""Rays through a grid of density and colour: marching, interpolation and compositing, in Taichi.

One thread per ray. The grid has N + 1 nodes (k, j, i) along each side, at z, y, x = -1 .. 1, or, in
unbounded, contracted space, at -2 .. 2. Numbers are interpolated linearly between the nodes. A raw
density r gives the density e^r, or 0 if r is at most `least`. For each channel, the sum s of the
spherical harmonics of the direction, times their coefficients, gives the colour 1 / (1 + e^-s). The
density is clamped at e^11, but its gradient does not become 0 there. With w_i, T_i, G_i as in
radiance/compositing.py:

    dL/dr_i = sigma_i d_i (T_{i+1} G_i - sum_{j > i} w_j G_j) where r_i > least, else 0,
    dL/ds_i = w_i dL/dC c_i (1 - c_i),    at a node: dL/dr = sum_i b_i dL/dr_i,
    and of a coefficient sum_i b_i Y dL/ds_i, with b_i the node's share in sample i, Y the harmonic.

The backward pass walks again. sum_j w_j G_j over the samples after i is linear in the results of
the forward pass minus those of the samples up to i, so it is computed from this difference.
"""

from typing import Any

import numpy as np

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import on_cpu, primitive, scratch
from cvkern.kernels.taichi.radiance._structs import Grid, march_of

from ._march import march_all


@primitive
def render(
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    grid: codes.Grid,
    stop: float,
    seen: codes.Composited,
    samples: np.ndarray,
) -> None:
    """Render rays, and count their samples that are not empty.

    The first `active` rays are marched through `space` as in `march.steps.march_rays`. But there is
    one level of cells, whose side is a power of 2 of the grid's cells, and `cone` is 0 unless
    `unbounded`. A ray ends where at most the share `stop` of the light is left. `seen`, of R rays,
    is filled as by `compositing.forward`; `samples` (R,) are the numbers of samples, 0 for the
    other rays.
    """
    # The forward pass does not read the gradients.
    nothing = grid.density, grid.color, scratch((1, 1, 1), np.uint8)
    _launch(False, False, seen, (rays, space, march, grid, stop), seen, samples, nothing)


@primitive
def render_backward(
    d_seen: codes.Composited,
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    grid: codes.Grid,
    stop: float,
    seen: codes.Composited,
    samples: np.ndarray,
    d_density: np.ndarray,
    d_color: np.ndarray,
    touched: np.ndarray,
) -> None:
    """Add the gradients of the grid, and mark the nodes that have gradients.

    `d_seen` are gradients by the results of :func:`render` for the same rays, `seen` and `samples`.
    `d_density` and `d_color` have the shapes of the grid; `touched` (N + 1, N + 1, N + 1) is set to
    1 at nodes with gradients. On CUDA `d_density` and `d_color` may be int64, for fixed-point
    numbers, whose sums do not depend on the order. On the CPU one thread processes all rays in
    order, so the sums are the same in every run.
    """
    outputs = d_density, d_color, touched
    _launch(True, on_cpu(), d_seen, (rays, space, march, grid, stop), seen, samples, outputs)


def _launch(
    backward: bool, serial: bool, d_seen: Any, given: tuple, seen: Any, samples: Any, outputs: Any
) -> None:
    """Launch the kernel, whose arguments are numbers and arrays."""
    rays, space, march, grid, stop = given
    exact = outputs[1].dtype == np.int64
    march_all(
        backward, serial, exact, *d_seen, *rays, space.bits, march_of(space, march),
        Grid(basis=grid.basis, least=grid.least, stop=stop), march.step, grid.density, grid.color,
        *seen, samples, *outputs,
    )  # fmt: skip
