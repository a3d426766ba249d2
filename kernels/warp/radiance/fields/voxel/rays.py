"""Rays through a grid of density and colour: marched, read and composited at once, in Warp.

The grid has N + 1 nodes (k, j, i) along each side, at z, y, x = -1 .. 1, or in all of space,
contracted, at -2 .. 2. Between them its numbers are interpolated linearly: a raw density r, with
density e^r, or 0 where r is at most `least`, and for each channel the coefficients of spherical
harmonics of the direction, whose sum s is made a colour 1 / (1 + e^-s). The density is cut off at
e^11, but its gradient is not made 0 there. With w_i, T_i, G_i as in radiance/compositing.py:

    dL/dr_i = sigma_i d_i (T_{i+1} G_i - sum_{j > i} w_j G_j) where r_i > least, else 0,
    dL/ds_i = w_i dL/dC c_i (1 - c_i),    at a node: dL/dr = sum_i b_i dL/dr_i,
    and of a coefficient sum_i b_i Y dL/ds_i, with b_i the node's share in sample i, Y the harmonic.

The backward pass walks again. What it needs of the samples behind i is what the forward pass
returned, less what has been passed: sum_j w_j G_j is linear in that. On CUDA a warp walks a ray and
adds by atomics, whose order does not show where sums are integers; on the CPU a thread walks some
rays and notes what each sample has to add, and then each thread adds to nodes of its own, in the
order of the rays.
"""

import numpy as np
import warp as wp

from cvkern.kernels.warp._launch import (
    cpu_threads,
    launch,
    launch_slabs,
    scratch,
)

from . import _rays_cpu as cpu
from . import _rays_cuda as cuda
from ._march import march_of
from ._walk_cpu import RECORD

wp.set_module_options({"enable_backward": False})

RAYS = 64  # of a slab on the CPU: as they differ in length, there are many slabs
SAMPLES = 4096  # what is kept of samples has room for a multiple of so many


def render(
    origins: wp.array,
    directions: wp.array,
    active: wp.array,
    bits: wp.array,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    unbounded: bool,
    jittered: bool,
    seed: int,
    step: wp.array,
    stop: float,
    least: float,
    basis: int,
    density: wp.array,
    color: wp.array,
    colors: wp.array,
    opacity: wp.array,
    depth: wp.array,
    distortion: wp.array,
    samples: wp.array,
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
    count = origins.shape[0]
    march = march_of(
        bits, cells, near, far, finest, cone, unbounded, jittered, seed, step, stop, least, basis,
        density, color,
    )  # fmt: skip
    inputs = [origins, directions, active, march]
    outputs = [colors, opacity, depth, distortion, samples]
    if density.device.is_cuda:
        launch(cuda.render, cuda.THREADS * count, inputs, outputs, cuda.BLOCK)
    else:
        kernel = cpu.kernels(color.shape[3]).render
        launch_slabs(kernel, count, -(-count // RAYS), inputs, outputs)


def render_backward(
    d_colors: wp.array,
    d_opacity: wp.array,
    d_depth: wp.array,
    d_distortion: wp.array,
    origins: wp.array,
    directions: wp.array,
    active: wp.array,
    bits: wp.array,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    unbounded: bool,
    jittered: bool,
    seed: int,
    step: wp.array,
    stop: float,
    least: float,
    basis: int,
    density: wp.array,
    color: wp.array,
    colors: wp.array,
    opacity: wp.array,
    depth: wp.array,
    distortion: wp.array,
    samples: wp.array,
    d_density: wp.array,
    d_color: wp.array,
    touched: wp.array,
) -> None:
    """Add the gradients of the grid, and mark its nodes that have any.

    `d_colors` (R, 3), `d_opacity`, `d_depth` and `d_distortion` (R,) are those of what
    :func:`render` made of the same rays, `colors` to `samples`. `d_density` and `d_color` have the
    shapes of the grid, as has `touched` (N + 1, N + 1, N + 1), which is set to 1 at such nodes. On
    CUDA `d_density` and `d_color` may be int64, of fixed-point numbers: their sums are the same in
    any order.
    """
    count = origins.shape[0]
    march = march_of(
        bits, cells, near, far, finest, cone, unbounded, jittered, seed, step, stop, least, basis,
        density, color,
    )  # fmt: skip
    gradients = [d_colors, d_opacity, d_depth, d_distortion]
    rendered = [colors, opacity, depth, distortion]
    outputs = [d_density, d_color, touched]
    if density.device.is_cuda:
        inputs = [*gradients, origins, directions, active, march, *rendered, samples]
        kernel = cuda.render_backward(d_color.dtype)
        launch(kernel, cuda.THREADS * count, inputs, outputs, cuda.BLOCK)
        return
    kernels = cpu.kernels(color.shape[3])
    # Kernels of the CPU are done when their launch is: the host can read what they wrote.
    ends = scratch("voxel.ends", (count,), wp.int64, density.device)
    np.cumsum(samples.numpy(), out=ends.numpy())
    room = -(-max(1, int(ends.numpy()[-1])) // SAMPLES) * SAMPLES
    records = scratch("voxel.records", (room, RECORD), wp.float32, density.device)
    inputs = [*gradients, origins, directions, march, *rendered, ends]
    launch_slabs(kernels.trace, count, -(-count // RAYS), inputs, [records])
    owners = 2 if cpu_threads() <= 2 else 4
    inputs = [owners, directions, basis, ends, records]
    launch_slabs(kernels.scatter, owners, owners, inputs, outputs)
