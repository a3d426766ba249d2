"""Splats that have faded become copies of others, as in 3DGS-MCMC [Kheradmand et al., 2024]."""

from __future__ import annotations

import numpy as np

FADED = 0.005  # opacity at which a splat is not needed
MOST_COPIES = 51


def relocated(opacities: np.ndarray, seed: int, step: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the splats that change, and their new values.

    Faded splats become copies of others, which are drawn in proportion to their opacities. A splat
    of which there are n then gets the opacity o' = 1 - (1 - o)^(1/n), with which n copies hide as
    much as it did, and the size that keeps the light that passes beside its middle.

    Returns
    -------
    rows : array of shape (M, 2), int32
        The splats that change, and those that they become; the faded ones come first.
    numbers : array of shape (M, 2), float32
        Their opacities before the logistic function, and the change of the logarithms of their
        sizes.
    count : int
        Number of the faded ones.
    """
    kept = np.flatnonzero(opacities > FADED)
    faded = np.flatnonzero(opacities <= FADED)
    if not kept.size or not faded.size:
        return np.zeros((0, 2), np.int32), np.zeros((0, 2), np.float32), 0
    sums = np.cumsum(opacities[kept], dtype=np.float64)
    drawn = np.random.Generator(np.random.Philox(key=(seed, step))).random(faded.size)
    places = np.searchsorted(sums, drawn * sums[-1], side="right")
    sources, inverse, copies = np.unique(
        kept[np.minimum(places, kept.size - 1)], return_inverse=True, return_counts=True
    )
    numbers = np.stack(shared(opacities[sources].astype(np.float64), copies + 1), axis=1)
    rows = np.concatenate((
        np.stack((faded, sources[inverse]), axis=1), np.stack((sources, sources), axis=1)
    ))  # fmt: skip
    numbers = np.concatenate((numbers[inverse], numbers))
    return rows.astype(np.int32), numbers.astype(np.float32), faded.size


def shared(opacity: np.ndarray, copies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the opacity of each of n copies, before the logistic function, and ln(s' / s).

    s' = s o / sum_{k=1}^{n} C(n, k) (-1)^(k-1) o'^k / sqrt(k), equation 9 of the article, whose
    inner sum of binomial coefficients is written as one.
    """
    from scipy.special import comb

    n = np.minimum(copies, MOST_COPIES)
    less = -np.expm1(np.log1p(-opacity.clip(None, 1 - 1e-6)) / n)
    k = np.arange(1, MOST_COPIES + 1)
    terms = comb(n[:, None], k) * (-1.0) ** (k - 1) * less[:, None] ** k / np.sqrt(k)
    less = less.clip(FADED, 1 - 1e-6)
    return np.log(less / (1 - less)), np.log(opacity / terms.sum(axis=1))
