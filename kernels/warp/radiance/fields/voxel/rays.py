"""Rays through a grid of density and colour: marching, interpolation and compositing, in Warp.

The grid has N + 1 nodes (k, j, i) along each side, at z, y, x = -1 .. 1, or, in unbounded,
contracted space, at -2 .. 2. Numbers are interpolated linearly between the nodes. A raw density r
gives the density e^r, or 0 if r is at most `least`. For each channel, the sum s of the spherical
harmonics of the direction, times their coefficients, gives the colour 1 / (1 + e^-s). The density
is clamped at e^11, but its gradient does not become 0 there. With w_i, T_i, G_i as in
radiance/compositing.py:

    dL/dr_i = sigma_i d_i (T_{i+1} G_i - sum_{j > i} w_j G_j) where r_i > least, else 0,
    dL/ds_i = w_i dL/dC c_i (1 - c_i),    at a node: dL/dr = sum_i b_i dL/dr_i,
    and of a coefficient sum_i b_i Y dL/ds_i, with b_i the node's share in sample i, Y the harmonic.

The backward pass walks again. sum_j w_j G_j over the samples after i is linear in the results of
the forward pass minus those of the samples up to i, so it is computed from this difference. On CUDA
a warp walks a ray and adds by atomics; their order has no effect on integer sums. On the CPU a
thread walks some rays and records the gradients of each sample; then each thread adds to its own
nodes, in the order of the rays.
"""

from typing import Any

import numpy as np
import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import (
    cpu_threads,
    launch,
    launch_slabs,
    scratch,
)
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._structs import Composited, Grid, March, Rays, Space

from . import _rays_cpu as cpu
from . import _rays_cuda as cuda
from ._rays_cpu import RECORD

wp.set_module_options({"enable_backward": False})

RAYS = 64  # rays per slab on the CPU; few, because rays differ in length
SAMPLES = 4096  # the room for records of samples is a multiple of this


def render(
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    grid: codes.Grid,
    stop: float,
    seen: codes.Composited,
    samples: wp.array,
) -> None:
    """Render rays, and count their samples that are not empty.

    The first `active` rays are marched through `space` as in `march.steps.march_rays`. But there is
    one level of cells, whose side is a power of 2 of the grid's cells, and `cone` is 0 unless
    `unbounded`. A ray ends where at most the share `stop` of the light is left. `seen`, of R rays,
    is filled as by `compositing.forward`; `samples` (R,) are the numbers of samples, 0 for the
    other rays.
    """
    count = rays.origins.shape[0]
    inputs, outputs = _given(rays, space, march, grid, stop), [struct_of(Composited, seen), samples]
    if grid.density.device.is_cuda:
        launch(cuda.render, cuda.THREADS * count, inputs, outputs, cuda.BLOCK)
    else:
        kernel = cpu.kernels(grid.color.shape[3]).render
        launch_slabs(kernel, count, -(-count // RAYS), inputs, outputs)


def render_backward(
    d_seen: codes.Composited,
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    grid: codes.Grid,
    stop: float,
    seen: codes.Composited,
    samples: wp.array,
    d_density: wp.array,
    d_color: wp.array,
    touched: wp.array,
) -> None:
    """Add the gradients of the grid, and mark the nodes that have gradients.

    `d_seen` are gradients by the results of :func:`render` for the same rays, `seen` and `samples`.
    `d_density` and `d_color` have the shapes of the grid; `touched` (N + 1, N + 1, N + 1) is set to
    1 at nodes with gradients. On CUDA `d_density` and `d_color` may be int64, for fixed-point
    numbers, whose sums do not depend on the order.
    """
    count = rays.origins.shape[0]
    given = [*_given(rays, space, march, grid, stop), struct_of(Composited, seen)]
    inputs, outputs = [struct_of(Composited, d_seen), *given], [d_density, d_color, touched]
    if d_density.device.is_cuda:
        kernel = cuda.render_backward(d_color.dtype)
        launch(kernel, cuda.THREADS * count, [*inputs, samples], outputs, cuda.BLOCK)
        return
    kernels = cpu.kernels(grid.color.shape[3])
    # A CPU kernel is done when its launch returns, so the host can read its results.
    ends = scratch("voxel.ends", (count,), wp.int64, d_density.device)
    np.cumsum(samples.numpy(), out=ends.numpy())
    room = -(-max(1, int(ends.numpy()[-1])) // SAMPLES) * SAMPLES
    records = scratch("voxel.records", (room, RECORD), wp.float32, d_density.device)
    launch_slabs(kernels.trace, count, -(-count // RAYS), [*inputs, ends], [records])
    owners = 2 if cpu_threads() <= 2 else 4
    inputs = [owners, rays.directions, grid.basis, ends, records]
    launch_slabs(kernels.scatter, owners, owners, inputs, outputs)


def _given(
    rays: codes.Rays, space: codes.Space, march: codes.March, grid: codes.Grid, stop: float
) -> list[Any]:
    return [
        struct_of(Rays, rays), struct_of(Space, space), struct_of(March, march),
        struct_of(Grid, grid), stop,
    ]  # fmt: skip
