"""Gradients: scikit-image's Sobel magnitude, and derivatives with their polar form."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

import cvkern
from profiling.arrays import noise
from profiling.case import (
    Case,
    Peer,
    in_float64,
    kornia_peers,
    ndimage_peers,
    relative,
    skimage_peers,
)

from .linear import BORDER_REFLECT, CV_32F, SIGMA, TAPS, gaussian_taps

# Derivatives cancel, and magnitude and angle hang on two of them: a little over filters.FLOAT32.
DERIVED = 1e-5


def _polar_difference(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Compare angles as vectors: -pi is pi, and the angle of nothing is nothing."""

    def vectors(f: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        return (*f[:3], f[2] * np.sin(f[3]), f[2] * np.cos(f[3])) if len(f) == 4 else f

    return relative(vectors(ours), vectors(theirs))


def _opencv_sobel(cv2: Any, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return cv2.Sobel(x, CV_32F, 0, 1), cv2.Sobel(x, CV_32F, 1, 0)


def _opencv_magnitude(cv2: Any, x: np.ndarray) -> tuple[np.ndarray, ...]:
    dy, dx = _opencv_sobel(cv2, x)
    return dy, dx, cv2.magnitude(dx, dy)


def _opencv_polar(cv2: Any, x: np.ndarray) -> tuple[np.ndarray, ...]:
    dy, dx = _opencv_sobel(cv2, x)
    return (dy, dx, *cv2.cartToPolar(dx, dy))


def _opencv_gaussian_polar(cv2: Any, x: np.ndarray) -> tuple[np.ndarray, ...]:
    blur, slope = gaussian_taps(0), gaussian_taps(1)
    dy = cv2.sepFilter2D(x, CV_32F, blur, slope, borderType=BORDER_REFLECT)
    dx = cv2.sepFilter2D(x, CV_32F, slope, blur, borderType=BORDER_REFLECT)
    return (dy, dx, *cv2.cartToPolar(dx, dy))


# One function each for the oracle (SciPy in float64), for SciPy, and for CuPy.
def _sobel_gradient(m: Any, x: Any, xp: Any) -> tuple[Any, ...]:
    dy, dx = (m.sobel(x, axis=axis, mode="mirror") for axis in (0, 1))
    return dy, dx, xp.hypot(dx, dy), xp.arctan2(dy, dx)


def _gaussian_gradient(m: Any, x: Any, xp: Any) -> tuple[Any, ...]:
    dy, dx = (m.gaussian_filter(x, SIGMA, order=order) for order in ((1, 0), (0, 1)))
    return dy, dx, xp.hypot(dx, dy), xp.arctan2(dy, dx)


CASES = (
    Case(
        name="sobel",
        title="Sobel magnitude, float32",
        image=noise,
        call=lambda x: cvkern.sobel(x),
        oracle=lambda x: importlib.import_module("skimage.filters").sobel(x.astype(np.float64)),
        oracle_name="skimage.filters.sobel in float64",
        difference=relative,
        tolerance=DERIVED,
        bytes_per_pixel=8,
        operations_per_pixel=28,
        peers=(
            *skimage_peers("filters", lambda m, x: m.sobel(x)),
            *kornia_peers(lambda m, x: m.sobel(x, 3), "other units"),
        ),
    ),
    Case(
        name="gradient_sobel",
        title="Sobel gradient, magnitude and angle, float32",
        image=noise,
        call=lambda x: cvkern.gradient(x, sigma=0.0, operator="sobel", mode="mirror"),
        oracle=in_float64(_sobel_gradient),
        oracle_name="scipy.ndimage.sobel in float64",
        difference=_polar_difference,
        tolerance=DERIVED,
        bytes_per_pixel=20,
        operations_per_pixel=48,
        peers=(
            Peer("OpenCV", "cv2", _opencv_magnitude, note="no angle"),
            Peer("OpenCV, angle", "cv2", _opencv_polar, note="angle to 1e-4 rad"),
            *ndimage_peers(_sobel_gradient),
        ),
    ),
    Case(
        name="gradient_gaussian",
        title="Gaussian derivatives, sigma 2, magnitude and angle, float32",
        image=noise,
        call=lambda x: cvkern.gradient(x, sigma=SIGMA),
        oracle=in_float64(_gaussian_gradient),
        oracle_name="scipy.ndimage.gaussian_filter in float64",
        difference=_polar_difference,
        tolerance=DERIVED,
        bytes_per_pixel=20,
        operations_per_pixel=4 * 2 * TAPS + 24,
        peers=(
            Peer("OpenCV", "cv2", _opencv_gaussian_polar, note="angle to 1e-4 rad"),
            *ndimage_peers(_gaussian_gradient),
        ),
    ),
)
