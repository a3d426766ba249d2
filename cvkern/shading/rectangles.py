"""Poisson's equation in a rectangle, by cosine transforms."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime

MOST_SIDE = 2**15  # pixels of the longer side; the tables of a GPU have a row for each


class Tables(NamedTuple):
    """Numbers of a side of N pixels."""

    waves: Any
    """cos(2 pi k / N) and sin(2 pi k / N), (N, 2)."""
    quarters: Any
    """cos(pi k / 2N) and sin(pi k / 2N), (N, 2)."""
    values: Any
    """The part of the eigenvalues, 4 sin^2(pi k / 2N), (N,)."""


def solve_rectangle(rt: Runtime, slope: Any, depth: Any) -> None:
    """Write the depth, of mean 0, whose rises differ least from the slopes; both are kernel arrays.

    On the CPU, SciPy's transforms take float64; on a GPU, kernels take float32.
    """
    if rt.device == "cpu":
        rt.write(depth, _on_host(rt.host_view(slope)))
    else:
        solve_by_kernels(rt, slope, depth)


def solve_by_kernels(rt: Runtime, slope: Any, depth: Any) -> None:
    """Write the same by kernels alone, in float32."""
    height, width = depth.shape
    kernels = rt.shading.integration.cosines
    columns = [rt.scratch(f"relief.columns{n}", (height, -(-width // 2), 2)) for n in range(2)]
    rows = [rt.scratch(f"relief.rows{n}", (-(-height // 2), width, 2)) for n in range(2)]
    down, along = (Tables(*(rt.constant(t) for t in tables(n))) for n in (height, width))

    def transform(sign: float) -> None:
        before = 1
        for radix in factors(height):
            kernels.stage(columns[0], down.waves, radix, before, 0, sign, columns[1])
            columns.reverse()
            before *= radix

    kernels.begin(slope, columns[0])
    transform(-1.0)
    kernels.across(columns[0], down.quarters, rows[0])
    rt.shading.integration.rows.solve(
        along.waves, along.quarters, factors(width), down.values, along.values, *rows
    )
    kernels.back(rows[1], down.quarters, columns[0])
    transform(1.0)
    kernels.end(columns[0], depth)


@lru_cache(maxsize=8)
def tables(count: int) -> Tables:
    """Return the numbers of a side, float32."""
    turns = np.pi * np.arange(count) / (2 * count)
    waves, quarters = (
        np.stack([np.cos(t), np.sin(t)], axis=1).astype(np.float32) for t in (4 * turns, turns)
    )
    return Tables(waves, quarters, _eigenvalues(count).astype(np.float32))


def _eigenvalues(count: int) -> np.ndarray:
    """Return the part of a side of the eigenvalues, float64."""
    return 4 * np.sin(np.pi * np.arange(count) / (2 * count)) ** 2


def factors(count: int) -> list[int]:
    """Return factors of a number: 8 as often as possible, then 4 or 2, then odd primes."""
    found, factor = [], 8
    # A factor is at most the number that is left, so the loop ends below `count` rounds.
    while count > 1:
        if count % factor == 0:
            found.append(factor)
            count //= factor
        else:
            factor = {8: 4, 4: 2, 2: 3}.get(factor, factor + 2)
    return found


def _on_host(slope: np.ndarray) -> np.ndarray:
    """Return the depth for slopes along the columns and down the rows, (2 or more, H, W)."""
    from scipy.fft import dctn, idctn

    from cvkern.kernels._threads import cpu_threads

    across, down = slope[0].astype(np.float64), slope[1].astype(np.float64)
    across, down = (across[:, 1:] + across[:, :-1]) / 2, (down[1:] + down[:-1]) / 2
    right = np.zeros(slope.shape[1:])
    right[:, 1:] += across
    right[:, :-1] -= across
    right[1:] += down
    right[:-1] -= down
    y, x = (_eigenvalues(n) for n in slope.shape[1:])
    values = y[:, None] + x
    values[0, 0] = 1
    found = dctn(right, workers=cpu_threads()) / values
    found[0, 0] = 0  # the mean
    return np.asarray(idctn(found, workers=cpu_threads())).astype(np.float32)
