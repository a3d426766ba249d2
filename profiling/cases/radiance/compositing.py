"""Compositing of samples along rays to colours, opacities and depths."""

from __future__ import annotations

import numpy as np

from cvkern.radiance import composite_rays
from profiling.case import Case, Shape, Work, relative

EACH = 32  # samples of a ray
# Sums of 32 terms whose factors have some 35 roundings of 2^-24 each, and exponentials of 2^-22.
FLOAT32 = 2e-5


def _samples(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Make as many samples as pixels, of rays of equal numbers of samples."""
    rays = shape[0] * shape[1] // EACH
    steps = rng.uniform(0.01, 0.1, (rays, EACH)).astype(np.float32)
    distances = np.stack([np.cumsum(steps, axis=1), steps], axis=-1).reshape(-1, 2)
    density = rng.uniform(0, 2, rays * EACH).astype(np.float32)
    color = rng.random((rays * EACH, 3), np.float32)
    begins = np.arange(rays, dtype=np.int32) * EACH
    return density, color, distances, np.stack([begins, np.full_like(begins, EACH)], axis=1)


def _composite(
    density: np.ndarray, color: np.ndarray, distances: np.ndarray, spans: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Composite in float64: w_i = T_i (1 - exp(-sigma_i d_i)), T_i = exp(-sum_j<i sigma_j d_j)."""
    t, d = distances.astype(np.float64).reshape(-1, EACH, 2).transpose(2, 0, 1)
    thickness = density.astype(np.float64).reshape(-1, EACH) * d
    before = np.cumsum(thickness, axis=1) - thickness
    w = np.exp(-before) * -np.expm1(-thickness)
    seen = np.einsum("ri,ric->rc", w, color.reshape(-1, EACH, 3))
    spread = np.abs(t[:, :, None] - t[:, None, :])
    distortion = np.einsum("ri,rj,rij->r", w, w, spread) + (w**2 * d).sum(axis=1) / 3
    return seen, w.sum(axis=1), (w * t).sum(axis=1), distortion


CASES = (
    Case(
        name="composite_rays",
        title="Compositing of rays, 32 samples each, float32",
        image=_samples,
        call=lambda *samples: composite_rays(*samples, check=False),
        oracle=_composite,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=24,
        operations_per_pixel=20,
        work=Work("samples", lambda density, *_: density.size),
        margin=0,
    ),
)
