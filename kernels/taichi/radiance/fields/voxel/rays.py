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
    seen: codes.Seen,
    samples: np.ndarray,
) -> None:
    """Make out what rays see, and how many samples had any density.

    The first `active` of them are marched through `space` as by `march.steps.march_rays`, but there
    is one level of cells, each a power of 2 of the grid's cells along a side, and `cone` is 0
    unless `unbounded`. A ray ends where no more than `stop` of the light is left. `seen`, of R
    rays, is filled as by `compositing.forward`, and `samples` (R,) with the numbers of samples, 0
    for the other rays.
    """
    # The gradients are not looked at.
    nothing = grid.density, grid.color, scratch((1, 1, 1), np.uint8)
    _launch(False, False, seen, (rays, space, march, grid, stop), seen, samples, nothing)


@primitive
def render_backward(
    d_seen: codes.Seen,
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    grid: codes.Grid,
    stop: float,
    seen: codes.Seen,
    samples: np.ndarray,
    d_density: np.ndarray,
    d_color: np.ndarray,
    touched: np.ndarray,
) -> None:
    """Add the gradients of the grid, and mark its nodes that have any.

    `d_seen` are those of what :func:`render` made of the same rays, `seen` and `samples`.
    `d_density` and `d_color` have the shapes of the grid, as has `touched`
    (N + 1, N + 1, N + 1), which is set to 1 at such nodes. On CUDA `d_density` and `d_color` may be
    int64, of fixed-point numbers: their sums are the same in any order. On the CPU one
    thread does all rays in turn: the sums do not change from run to run.
    """
    outputs = d_density, d_color, touched
    _launch(True, on_cpu(), d_seen, (rays, space, march, grid, stop), seen, samples, outputs)


def _launch(
    backward: bool, serial: bool, d_seen: Any, given: tuple, seen: Any, samples: Any, outputs: Any
) -> None:
    """Launch the kernel, whose arguments are single numbers and arrays."""
    rays, space, march, grid, stop = given
    exact = outputs[1].dtype == np.int64
    march_all(
        backward, serial, exact, *d_seen, *rays, space.bits, march_of(space, march),
        Grid(basis=grid.basis, least=grid.least, stop=stop), march.step, grid.density, grid.color,
        *seen, samples, *outputs,
    )  # fmt: skip
