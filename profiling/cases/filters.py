"""Filters: Gaussian, separable taps, box, median, Sobel, and the gradient in polar form."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import scipy.ndimage

import cvkern

from ..arrays import noise, noise_uint8
from ..case import Case, Peer, kornia_peers, ndimage_peers, relative, skimage_peers, unequal

SIGMA, TAPS = 2.0, 17  # int(4 sigma + 0.5) taps on either side
BORDER_REFLECT, CV_32F = 2, 5  # the codes in cv2

# A pass of n taps rounds 2 n times, each within 2^-24 of a partial sum: two passes of 17 taps stay
# within 68 * 6e-8 = 4e-6 of the largest value. Derivatives cancel, and three fields hang on two.
FLOAT32 = 4e-6
DERIVED = 1e-5


@cache
def _taps(order: int) -> np.ndarray:
    """Correlation taps of the Gaussian's derivative: what SciPy makes of an impulse, reversed."""
    impulse = np.zeros(TAPS)
    impulse[TAPS // 2] = 1.0
    response = scipy.ndimage.gaussian_filter1d(impulse, SIGMA, order=order, mode="constant")
    return response[::-1].astype(np.float32)


@cache
def _skewed() -> np.ndarray:
    """Taps without symmetry, so that none may halve the work by folding them."""
    return np.random.default_rng(0).random(15, np.float32) / 15


@cache
def _torch_taps() -> tuple[Any, Any]:
    torch = importlib.import_module("torch")
    taps = torch.from_numpy(_taps(0).copy()).cuda()
    return taps.reshape(1, 1, -1, 1), taps.reshape(1, 1, 1, -1)


def _torch_gaussian(torch: Any, x: Any) -> Any:
    conv, pad = torch.nn.functional.conv2d, torch.nn.functional.pad
    down, along = _torch_taps()
    r = TAPS // 2
    return conv(conv(pad(x[None, None], (r, r, r, r), mode="reflect"), down), along)[0, 0]


def _cvcuda_gaussian(cvcuda: Any, x: Any) -> Any:
    return cvcuda.gaussian(x, (TAPS, TAPS), (SIGMA, SIGMA), cvcuda.Border.REFLECT)


def _opencv_gaussian(cv2: Any, x: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(x, (TAPS, TAPS), SIGMA, borderType=BORDER_REFLECT)


def _opencv_correlate(cv2: Any, x: np.ndarray) -> np.ndarray:
    return cv2.sepFilter2D(x, CV_32F, _skewed(), _skewed(), borderType=BORDER_REFLECT)


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
    blur, slope = _taps(0), _taps(1)
    dy = cv2.sepFilter2D(x, CV_32F, blur, slope, borderType=BORDER_REFLECT)
    dx = cv2.sepFilter2D(x, CV_32F, slope, blur, borderType=BORDER_REFLECT)
    return (dy, dx, *cv2.cartToPolar(dx, dy))


# One function each for the oracle (SciPy in float64), for SciPy, and for CuPy.
def _gaussian(m: Any, x: Any, xp: Any) -> Any:
    return m.gaussian_filter(x, SIGMA)


def _correlate(m: Any, x: Any, xp: Any) -> Any:
    taps = xp.asarray(_skewed())
    return m.correlate1d(m.correlate1d(x, taps, axis=0), taps, axis=1)


def _mean(m: Any, x: Any, xp: Any) -> Any:
    return m.uniform_filter(x, 9)


def _median(m: Any, x: Any, xp: Any) -> Any:
    return m.median_filter(x, 5, mode="nearest")


def _sobel_gradient(m: Any, x: Any, xp: Any) -> tuple[Any, ...]:
    dy, dx = (m.sobel(x, axis=axis, mode="mirror") for axis in (0, 1))
    return dy, dx, xp.hypot(dx, dy), xp.arctan2(dy, dx)


def _gaussian_gradient(m: Any, x: Any, xp: Any) -> tuple[Any, ...]:
    dy, dx = (m.gaussian_filter(x, SIGMA, order=order) for order in ((1, 0), (0, 1)))
    return dy, dx, xp.hypot(dx, dy), xp.arctan2(dy, dx)


def _oracle(call: Callable[[Any, Any, Any], Any]) -> Callable[[np.ndarray], Any]:
    return lambda x: call(scipy.ndimage, x.astype(np.float64), np)


CASES = (
    Case(
        name="gaussian",
        title="Gaussian, sigma 2, float32",
        image=noise,
        call=lambda x: cvkern.gaussian(x, SIGMA),
        oracle=_oracle(_gaussian),
        oracle_name="scipy.ndimage.gaussian_filter in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=8,
        operations_per_pixel=2 * 2 * TAPS,
        peers=(
            Peer("OpenCV", "cv2", _opencv_gaussian),
            *skimage_peers("filters", lambda m, x: m.gaussian(x, SIGMA, mode="reflect")),
            *ndimage_peers(_gaussian),
            Peer("torch", "torch", _torch_gaussian, "cuda", "TF32, torch's default"),
            kornia_peers(lambda m, x: m.gaussian_blur(x, (TAPS, TAPS), (SIGMA, SIGMA)))[1],
            Peer("CV-CUDA", "cvcuda", _cvcuda_gaussian, "cuda"),
        ),
    ),
    Case(
        name="correlate_separable",
        title="15 taps without symmetry, float32",
        image=noise,
        call=lambda x: cvkern.correlate_separable(x, _skewed()),
        oracle=_oracle(_correlate),
        oracle_name="scipy.ndimage.correlate1d in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=8,
        operations_per_pixel=2 * 2 * 15,
        peers=(Peer("OpenCV", "cv2", _opencv_correlate), *ndimage_peers(_correlate)),
    ),
    Case(
        name="box",
        title="Mean of 9 x 9, float32",
        image=noise,
        call=lambda x: cvkern.box(x, 4),
        oracle=_oracle(_mean),
        oracle_name="scipy.ndimage.uniform_filter in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=8,
        operations_per_pixel=5,  # two running sums and a product
        peers=(
            Peer("OpenCV", "cv2", lambda m, x: m.blur(x, (9, 9), borderType=BORDER_REFLECT)),
            *ndimage_peers(_mean),
            kornia_peers(lambda m, x: m.box_blur(x, (9, 9)))[1],
            Peer(
                "torch", "torch", lambda m, x: m.nn.functional.avg_pool2d(x[None], 9, 1, 4), "cuda"
            ),
        ),
    ),
    Case(
        name="median",
        title="Median of 5 x 5, uint8",
        image=noise_uint8,
        call=lambda x: cvkern.median(x, 2, mode="nearest"),
        oracle=lambda x: _median(scipy.ndimage, x, np),
        oracle_name="scipy.ndimage.median_filter",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=2,
        operations_per_pixel=2 * 99,  # a sorting network of 99 exchanges
        peers=(
            Peer("OpenCV", "cv2", lambda m, x: m.medianBlur(x, 5)),
            *ndimage_peers(_median),
            *kornia_peers(lambda m, x: m.median_blur(x, 5)),
            Peer("CV-CUDA", "cvcuda", lambda m, x: m.median_blur(x, (5, 5)), "cuda"),
        ),
    ),
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
        oracle=_oracle(_sobel_gradient),
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
        oracle=_oracle(_gaussian_gradient),
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
