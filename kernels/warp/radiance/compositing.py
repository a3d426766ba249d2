"""Compositing of packed samples along rays, forward and backward, in Warp.

One thread per ray on the CPU, one warp per ray on CUDA. A ray has samples i of density sigma_i,
colour c_i, distance t_i and length d_i:

    alpha_i = 1 - exp(-sigma_i d_i),  T_i = prod_{j < i} (1 - alpha_j),  w_i = T_i alpha_i,
    C = sum w_i c_i,  O = sum w_i,  D = sum w_i t_i,
    X = sum_ij w_i w_j |t_i - t_j| + 1/3 sum w_i^2 d_i        (distortion, mip-NeRF 360)

With dw_i/dsigma_i = d_i T_{i+1}, dw_j/dsigma_i = -d_i w_j for j > i, and G_i = dL/dw_i,

    dL/dsigma_i = d_i (T_{i+1} G_i - sum_{j > i} w_j G_j),  dL/dc_i = w_i dL/dC,

    G_i = <dL/dC, c_i> + dL/dO + dL/dD t_i + dL/dX (2 sum_j w_j |t_i - t_j| + 2/3 w_i d_i).

The backward pass walks along the ray twice, and computes the weights again instead of storing them.
Both passes end where at most the share `stop` of the light is left; samples after that have no
gradient.
"""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import launch, launch_each
from cvkern.kernels.warp._structs import struct_of

from . import _compositing_cuda as cuda
from ._space import row
from ._structs import Composited

wp.set_module_options({"enable_backward": False})


@wp.kernel
def forward_kernel(
    stride: int,
    first: int,
    last: int,
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    spans: wp.array2d[int],  # (R, 2)
    stop: float,
    # outputs
    seen: Composited,
):
    """Walk along each ray once."""
    for ray in range(first + wp.tid(), last, stride):
        left = float(1.0)  # T
        c = wp.vec3()
        sum_w = float(0.0)
        sum_wt = float(0.0)
        spread = float(0.0)
        i = spans[ray, 0]
        end = i + spans[ray, 1]
        while i < end and left > stop:
            t = distances[i, 0]
            w = left * (1.0 - wp.exp(-sigma[i] * distances[i, 1]))
            c += w * row(rgb, i)
            # t grows along the ray, so |t_i - t_j| = t_i - t_j for all samples j before.
            spread += w * (2.0 * (t * sum_w - sum_wt) + w * distances[i, 1] / 3.0)
            sum_w += w
            sum_wt += w * t
            left -= w
            i += 1
        for k in range(3):
            seen.color[ray, k] = c[k]
        seen.opacity[ray] = sum_w
        seen.depth[ray] = sum_wt
        seen.distortion[ray] = spread


@wp.kernel
def backward_kernel(
    stride: int,
    first: int,
    last: int,
    d_seen: Composited,
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    spans: wp.array2d[int],  # (R, 2)
    stop: float,
    # outputs
    d_sigma: wp.array[float],  # (M,)
    d_rgb: wp.array2d[float],  # (M, 3)
):
    """Walk along each ray twice."""
    for ray in range(first + wp.tid(), last, stride):
        begin = spans[ray, 0]
        end = begin + spans[ray, 1]
        dc = row(d_seen.color, ray)
        do = d_seen.opacity[ray]
        dd = d_seen.depth[ray]
        dx = d_seen.distortion[ray]
        # First walk: sums over all samples, which the second walk splits.
        left = float(1.0)
        sum_w = float(0.0)
        sum_wt = float(0.0)
        rest = float(0.0)  # sum of w_j G_j without the distortion
        spread = float(0.0)  # sum of w_j dX/dw_j = 2 X
        i = begin
        while i < end and left > stop:
            t = distances[i, 0]
            w = left * (1.0 - wp.exp(-sigma[i] * distances[i, 1]))
            rest += w * (wp.dot(dc, row(rgb, i)) + do + dd * t)
            spread += 2.0 * w * (2.0 * (t * sum_w - sum_wt) + w * distances[i, 1] / 3.0)
            sum_w += w
            sum_wt += w * t
            left -= w
            i += 1
        rest += dx * spread
        behind = int(i)  # the last sample that light reaches
        left = float(1.0)
        before_w = float(0.0)
        before_wt = float(0.0)
        for i in range(begin, behind):
            t = distances[i, 0]
            d = distances[i, 1]
            w = left * (1.0 - wp.exp(-sigma[i] * d))
            left -= w
            apart = t * before_w - before_wt  # sum of w_j |t_i - t_j| over j < i, then over j > i
            before_w += w
            before_wt += w * t
            apart += (sum_wt - before_wt) - t * (sum_w - before_w)
            g = wp.dot(dc, row(rgb, i)) + do + dd * t
            g += dx * (2.0 * apart + 2.0 / 3.0 * w * d)
            rest -= w * g
            d_sigma[i] = d * (left * g - rest)
            for k in range(3):
                d_rgb[i, k] = w * dc[k]
        for i in range(behind, end):
            d_sigma[i] = 0.0
            for k in range(3):
                d_rgb[i, k] = 0.0


def forward(
    sigma: wp.array,
    rgb: wp.array,
    distances: wp.array,
    spans: wp.array,
    stop: float,
    seen: codes.Composited,
) -> None:
    """Composite each ray front to back.

    `sigma` (M,), `rgb` (M, 3) and `distances` (M, 2) belong to samples; `spans` (R, 2) gives the
    rows of each ray. The results of the R rays are written to `seen`.
    """
    count = spans.shape[0]
    inputs = [sigma, rgb, distances, spans, stop]
    outputs = [struct_of(Composited, seen)]
    if spans.device.is_cuda:
        launch(cuda.forward, cuda.THREADS * count, inputs, outputs)
    else:
        launch_each(forward_kernel, count, 256 * count, inputs, outputs)


def backward(
    d_seen: codes.Composited,
    sigma: wp.array,
    rgb: wp.array,
    distances: wp.array,
    spans: wp.array,
    stop: float,
    d_sigma: wp.array,
    d_rgb: wp.array,
) -> None:
    """Compute `d_sigma` (M,) and `d_rgb` (M, 3) from gradients by the results of :func:`forward`.

    Rows of no ray stay unchanged.
    """
    count = spans.shape[0]
    inputs, outputs = (
        [struct_of(Composited, d_seen), sigma, rgb, distances, spans, stop],
        [d_sigma, d_rgb],
    )
    if spans.device.is_cuda:
        launch(cuda.backward, cuda.THREADS * count, inputs, outputs)
    else:
        launch_each(backward_kernel, count, 512 * count, inputs, outputs)
