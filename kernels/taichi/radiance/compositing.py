"""Compositing of packed samples along rays, forward and backward, in Taichi; one thread per ray.

A ray has samples i of density sigma_i, colour c_i, distance t_i and length d_i:

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

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import primitive

from ._space import row

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
vec3 = ti.types.vector(3, ti.f32)


@ti.kernel
def _forward(
    sigma: f32_1,  # (M,)
    rgb: f32_2,  # (M, 3)
    distances: f32_2,  # (M, 2)
    spans: i32_2,  # (R, 2)
    stop: ti.f32,
    # outputs
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depth: f32_1,  # (R,)
    distortion: f32_1,  # (R,)
):
    for ray in range(spans.shape[0]):
        left = 1.0  # T
        c = vec3(0.0)
        sum_w = 0.0
        sum_wt = 0.0
        spread = 0.0
        i = spans[ray, 0]
        end = i + spans[ray, 1]
        while i < end and left > stop:
            t = distances[i, 0]
            w = left * (1.0 - ti.exp(-sigma[i] * distances[i, 1]))
            c += w * row(rgb, i)
            # t grows along the ray, so |t_i - t_j| = t_i - t_j for all samples j before.
            spread += w * (2.0 * (t * sum_w - sum_wt) + w * distances[i, 1] / 3.0)
            sum_w += w
            sum_wt += w * t
            left -= w
            i += 1
        for k in ti.static(range(3)):
            color[ray, k] = c[k]
        opacity[ray] = sum_w
        depth[ray] = sum_wt
        distortion[ray] = spread


@ti.kernel
def _backward(
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_depth: f32_1,  # (R,)
    d_distortion: f32_1,  # (R,)
    sigma: f32_1,  # (M,)
    rgb: f32_2,  # (M, 3)
    distances: f32_2,  # (M, 2)
    spans: i32_2,  # (R, 2)
    stop: ti.f32,
    # outputs
    d_sigma: f32_1,  # (M,)
    d_rgb: f32_2,  # (M, 3)
):
    for ray in range(spans.shape[0]):
        begin = spans[ray, 0]
        end = begin + spans[ray, 1]
        dc = row(d_color, ray)
        do = d_opacity[ray]
        dd = d_depth[ray]
        dx = d_distortion[ray]
        # First walk: sums over all samples, which the second walk splits.
        left = 1.0
        sum_w = 0.0
        sum_wt = 0.0
        rest = 0.0  # sum of w_j G_j without the distortion
        spread = 0.0  # sum of w_j dX/dw_j = 2 X
        seen = begin
        while seen < end and left > stop:
            t = distances[seen, 0]
            d = distances[seen, 1]
            w = left * (1.0 - ti.exp(-sigma[seen] * d))
            rest += w * (dc.dot(row(rgb, seen)) + do + dd * t)
            spread += 2.0 * w * (2.0 * (t * sum_w - sum_wt) + w * d / 3.0)
            sum_w += w
            sum_wt += w * t
            left -= w
            seen += 1
        rest += dx * spread
        left = 1.0
        before_w = 0.0
        before_wt = 0.0
        for i in range(begin, seen):
            t = distances[i, 0]
            d = distances[i, 1]
            w = left * (1.0 - ti.exp(-sigma[i] * d))
            left -= w
            apart = t * before_w - before_wt  # sum of w_j |t_i - t_j| over j < i, then over j > i
            before_w += w
            before_wt += w * t
            apart += (sum_wt - before_wt) - t * (sum_w - before_w)
            g = dc.dot(row(rgb, i)) + do + dd * t + dx * (2.0 * apart + 2.0 / 3.0 * w * d)
            rest -= w * g
            d_sigma[i] = d * (left * g - rest)
            for k in ti.static(range(3)):
                d_rgb[i, k] = w * dc[k]
        for i in range(seen, end):
            d_sigma[i] = 0.0
            for k in ti.static(range(3)):
                d_rgb[i, k] = 0.0


@primitive
def forward(
    sigma: np.ndarray,
    rgb: np.ndarray,
    distances: np.ndarray,
    spans: np.ndarray,
    stop: float,
    seen: codes.Composited,
) -> None:
    """Composite each ray front to back.

    `sigma` (M,), `rgb` (M, 3) and `distances` (M, 2) belong to samples; `spans` (R, 2) gives the
    rows of each ray. The results of the R rays are written to `seen`.
    """
    _forward(sigma, rgb, distances, spans, stop, *seen)


@primitive
def backward(
    d_seen: codes.Composited,
    sigma: np.ndarray,
    rgb: np.ndarray,
    distances: np.ndarray,
    spans: np.ndarray,
    stop: float,
    d_sigma: np.ndarray,
    d_rgb: np.ndarray,
) -> None:
    """Compute `d_sigma` (M,) and `d_rgb` (M, 3) from gradients by the results of :func:`forward`.

    Rows of no ray stay unchanged.
    """
    _backward(*d_seen, sigma, rgb, distances, spans, stop, d_sigma, d_rgb)
