"""Elementary functions by sums and products alone, so that they have the same bits everywhere."""

from __future__ import annotations

import math

import numpy as np


def exp2(x: np.ndarray) -> np.ndarray:
    """Return 2^x, for float64 x in [-1, 3]."""
    y = x * math.log(2.0)
    total = np.ones_like(y)
    for n in range(30, 0, -1):  # total = 1 + y total / n
        total *= y
        total /= n
        total += 1.0
    return total


def cos_sin(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cosine and the sine of float64 angles in [-4, 4]."""
    square = x * x
    cosine, sine = np.ones_like(x), np.ones_like(x)
    for n in range(34, 0, -2):  # cosine = 1 - square cosine / (n (n - 1)), sine alike
        for total, factor in ((cosine, n * (n - 1)), (sine, n * (n + 1))):
            total *= square
            total /= factor
            np.subtract(1.0, total, out=total)
    return cosine, x * sine
