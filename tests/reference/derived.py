"""Gradients of compositing that Warp derives, of kernels that only state the definition."""

# Kernel bodies are Warp's language: no Python type checker reads them.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportAssignmentType=false, reportOptionalMemberAccess=false, reportAttributeAccessIssue=false

import warp as wp


# Without loops: Warp's derivatives of variables that a loop changes are not to be relied on.
@wp.kernel(enable_backward=True)
def depths_kernel(sigma: wp.array[float], distances: wp.array2d[float], before: wp.array[float]):
    i, j = wp.tid()
    if j < i:
        wp.atomic_add(before, i, sigma[j] * distances[j, 1])


@wp.kernel(enable_backward=True)
def weights_kernel(
    sigma: wp.array[float],
    distances: wp.array2d[float],
    before: wp.array[float],
    w: wp.array[float],
):
    i = wp.tid()
    w[i] = wp.exp(-before[i]) * (1.0 - wp.exp(-sigma[i] * distances[i, 1]))


@wp.kernel(enable_backward=True)
def loss_kernel(
    w: wp.array[float],
    rgb: wp.array2d[float],
    distances: wp.array2d[float],
    g: wp.array[float],  # (6,)
    loss: wp.array[float],
):
    i, j = wp.tid()
    apart = wp.abs(distances[i, 0] - distances[j, 0])
    wp.atomic_add(loss, 0, g[5] * w[i] * w[j] * apart)
    if i == j:
        seen = g[0] * rgb[i, 0] + g[1] * rgb[i, 1] + g[2] * rgb[i, 2] + g[3]
        wp.atomic_add(loss, 0, w[i] * (seen + g[4] * distances[i, 0]))
        wp.atomic_add(loss, 0, g[5] * w[i] * w[i] * distances[i, 1] / 3.0)


def composite_backward(g, sigma, rgb, distances):
    """Return the gradients of density and colour of one ray, given those of its six numbers."""
    wp.init()
    count = len(sigma)
    s, c, d = (
        wp.array(a, dtype=wp.float32, device="cpu", requires_grad=True)
        for a in (sigma, rgb, distances)
    )
    before, w, loss = (
        wp.zeros(n, dtype=wp.float32, device="cpu", requires_grad=True) for n in (count, count, 1)
    )
    given = wp.array(g, dtype=wp.float32, device="cpu")
    with wp.Tape() as tape:
        wp.launch(depths_kernel, (count, count), [s, d], [before], device="cpu")
        wp.launch(weights_kernel, count, [s, d, before], [w], device="cpu")
        wp.launch(loss_kernel, (count, count), [w, c, d, given], [loss], device="cpu")
    tape.backward(loss)
    return s.grad.numpy(), c.grad.numpy()
