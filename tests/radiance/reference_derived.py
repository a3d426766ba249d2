"""Gradients that Warp derives, from kernels that only state fields and compositing."""

# Kernel bodies are Warp's language: no Python type checker reads them.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportAssignmentType=false, reportCallIssue=false, reportOptionalMemberAccess=false, reportAttributeAccessIssue=false

import numpy as np
import warp as wp

from tests.radiance.fields import reference_voxel

# Without loops: Warp's derivatives of variables that a loop changes are not to be relied on.


@wp.kernel(enable_backward=True)
def depths_kernel(
    rays: wp.array[int],
    sigma: wp.array[float],
    distances: wp.array2d[float],
    before: wp.array[float],
):
    i, j = wp.tid()
    if j < i and rays[i] == rays[j]:
        wp.atomic_add(before, i, sigma[j] * distances[j, 1])


@wp.kernel(enable_backward=True)
def weights_kernel(
    sigma: wp.array[float],
    distances: wp.array2d[float],
    before: wp.array[float],
    stop: float,
    w: wp.array[float],
):
    i = wp.tid()
    if wp.exp(-before[i]) > stop:
        w[i] = wp.exp(-before[i]) * (1.0 - wp.exp(-sigma[i] * distances[i, 1]))


@wp.kernel(enable_backward=True)
def loss_kernel(
    rays: wp.array[int],
    w: wp.array[float],
    rgb: wp.array2d[float],
    distances: wp.array2d[float],
    g: wp.array2d[float],  # (R, 6)
    loss: wp.array[float],
):
    i, j = wp.tid()
    r = rays[i]
    if rays[j] == r:
        apart = wp.abs(distances[i, 0] - distances[j, 0])
        wp.atomic_add(loss, 0, g[r, 5] * w[i] * w[j] * apart)
    if i == j:
        seen = g[r, 0] * rgb[i, 0] + g[r, 1] * rgb[i, 1] + g[r, 2] * rgb[i, 2] + g[r, 3]
        wp.atomic_add(loss, 0, w[i] * (seen + g[r, 4] * distances[i, 0]))
        wp.atomic_add(loss, 0, g[r, 5] * w[i] * w[i] * distances[i, 1] / 3.0)


@wp.func
def between(grid: wp.array4d[float], node: wp.vec3i, f: wp.vec3, c: int):
    """Read channel `c` of a grid between the nodes (k, j, i) from `node` (i, j, k) on."""
    i, j, k = node[0], node[1], node[2]
    near = wp.lerp(
        wp.lerp(grid[k, j, i, c], grid[k, j, i + 1, c], f[0]),
        wp.lerp(grid[k, j + 1, i, c], grid[k, j + 1, i + 1, c], f[0]),
        f[1],
    )
    far = wp.lerp(
        wp.lerp(grid[k + 1, j, i, c], grid[k + 1, j, i + 1, c], f[0]),
        wp.lerp(grid[k + 1, j + 1, i, c], grid[k + 1, j + 1, i + 1, c], f[0]),
        f[1],
    )
    return wp.lerp(near, far, f[2])


@wp.kernel(enable_backward=True)
def density_kernel(
    nodes: wp.array[wp.vec3i],
    places: wp.array[wp.vec3],
    density: wp.array4d[float],
    least: float,
    sigma: wp.array[float],
):
    i = wp.tid()
    raw = between(density, nodes[i], places[i], 0)
    if raw > least:
        sigma[i] = wp.exp(raw)


@wp.kernel(enable_backward=True)
def harmonics_kernel(
    rays: wp.array[int],
    nodes: wp.array[wp.vec3i],
    places: wp.array[wp.vec3],
    harmonics: wp.array2d[float],  # (R, basis)
    basis: int,
    color: wp.array4d[float],
    sums: wp.array2d[float],
):
    i, c, k = wp.tid()
    value = between(color, nodes[i], places[i], c * basis + k)
    wp.atomic_add(sums, i, c, harmonics[rays[i], k] * value)


@wp.kernel(enable_backward=True)
def color_kernel(sums: wp.array2d[float], rgb: wp.array2d[float]):
    i, c = wp.tid()
    rgb[i, c] = 1.0 / (1.0 + wp.exp(-sums[i, c]))


def fixed(values, dtype=wp.float32):
    return wp.array(values, dtype=dtype, device="cpu")


def variable(values):
    return wp.array(values, dtype=wp.float32, device="cpu", requires_grad=True)


def composite(g, rays, sigma, rgb, distances, stop):
    """Launch the loss <g, what rays see>; `g` has a ray's colour, opacity, depth, distortion."""
    count, rays, distances = len(rays), fixed(rays, wp.int32), fixed(distances)
    before, w, loss = (variable(np.zeros(n)) for n in (count, count, 1))
    pairs = (count, count)
    wp.launch(depths_kernel, pairs, [rays, sigma, distances], [before], device="cpu")
    wp.launch(weights_kernel, count, [sigma, distances, before, stop], [w], device="cpu")
    wp.launch(loss_kernel, pairs, [rays, w, rgb, distances, fixed(g)], [loss], device="cpu")
    return loss


def composite_backward(g, sigma, rgb, distances):
    """Return the gradients of density and colour of one ray, given those of its six numbers."""
    wp.init()
    s, c = variable(sigma), variable(rgb)
    with wp.Tape() as tape:
        loss = composite(g[None], np.zeros(len(sigma)), s, c, distances, -1.0)
    tape.backward(loss)
    return s.grad.numpy(), c.grad.numpy()


def voxel_backward(
    g, origins, directions, active, bits, cells, near, far, finest, cone, unbounded, jittered,
    seed, step, stop, least, basis, density, color,
):  # fmt: skip
    """Return the gradients of both grids, given those of the six numbers of each ray."""
    wp.init()
    march = near, far, finest, cone, unbounded
    seen = []  # for each ray: distances, nodes and places in their cells
    for ray in range(int(active[0])):
        part = reference_voxel.jitter(seed, int(step[0]), ray) if jittered else 0.5
        ts, gaps, points = reference_voxel.places(
            origins[ray].astype(float), directions[ray].astype(float), *march, part
        )
        if len(ts):
            kept = reference_voxel.occupied(points, bits, cells)
            at = (points[kept] * (len(density) - 1)).clip(0, len(density) - 1)
            node = np.minimum(at.astype(int), len(density) - 2)
            numbers = np.full(kept.sum(), ray)
            seen.append((numbers, np.stack([ts, gaps], 1)[kept], node, at - node))
    rays, distances, nodes, places = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    count, table = len(rays), np.stack([reference_voxel.harmonics(d)[:basis] for d in directions])
    raw, coefficients = variable(density[..., None]), variable(color)
    sigma, sums, rgb = (variable(np.zeros(s)) for s in (count, (count, 3), (count, 3)))
    number, node, place = fixed(rays, wp.int32), fixed(nodes, wp.vec3i), fixed(places, wp.vec3)
    with wp.Tape() as tape:
        wp.launch(density_kernel, count, [node, place, raw, least], [sigma], device="cpu")
        inputs = [number, node, place, fixed(table), basis, coefficients]
        wp.launch(harmonics_kernel, (count, 3, basis), inputs, [sums], device="cpu")
        wp.launch(color_kernel, (count, 3), [sums], [rgb], device="cpu")
        loss = composite(g, rays, sigma, rgb, distances, stop)
    tape.backward(loss)
    return raw.grad.numpy()[..., 0], coefficients.grad.numpy()
