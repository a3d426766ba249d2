"""Filters: Gaussian, separable taps, box."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from profiling.arrays import noise, noise_uint8
from profiling.case import (
    Case,
    Peer,
    in_float64,
    kornia_peers,
    ndimage_peers,
    relative,
    skimage_peers,
)

SIGMA, TAPS = 2.0, 17  # int(4 sigma + 0.5) taps on either side
BORDER_REFLECT, CV_32F = 2, 5  # the codes in cv2

# A pass of n taps rounds 2 n times, each within 2^-24 of a partial sum: two passes of 17 taps stay
# within 68 * 6e-8 = 4e-6 of the largest value.
FLOAT32 = 4e-6


@cache
def gaussian_taps(order: int) -> np.ndarray:
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
    taps = torch.from_numpy(gaussian_taps(0).copy()).cuda()
    return taps.reshape(1, 1, -1, 1), taps.reshape(1, 1, 1, -1)


def _torch_gaussian(torch: Any, x: Any) -> Any:
    conv, pad = torch.nn.functional.conv2d, torch.nn.functional.pad
    down, along = _torch_taps()
    r = TAPS // 2
    return conv(conv(pad(x[None, None], (r, r, r, r), mode="reflect"), down), along)[0, 0]


def _torch_mean(torch: Any, x: Any) -> Any:
    return torch.nn.functional.avg_pool2d(x[None], 9, stride=1, padding=4)[0]


def _cvcuda_gaussian(cvcuda: Any, x: Any) -> Any:
    return cvcuda.gaussian(x, (TAPS, TAPS), (SIGMA, SIGMA), cvcuda.Border.REFLECT)


def _opencv_gaussian(cv2: Any, x: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(x, (TAPS, TAPS), SIGMA, borderType=BORDER_REFLECT)


def _opencv_correlate(cv2: Any, x: np.ndarray) -> np.ndarray:
    return cv2.sepFilter2D(x, CV_32F, _skewed(), _skewed(), borderType=BORDER_REFLECT)


# One function each for the oracle (SciPy in float64), for SciPy, and for CuPy.
def _gaussian(m: Any, x: Any, xp: Any) -> Any:
    return m.gaussian_filter(x, SIGMA)


def _correlate(m: Any, x: Any, xp: Any) -> Any:
    taps = xp.asarray(_skewed())
    return m.correlate1d(m.correlate1d(x, taps, axis=0), taps, axis=1)


def _mean(m: Any, x: Any, xp: Any) -> Any:
    return m.uniform_filter(x, 9)


CASES = (
    Case(
        name="gaussian",
        title="Gaussian, sigma 2, float32",
        image=noise,
        call=lambda x: cvkern.gaussian(x, SIGMA),
        oracle=in_float64(_gaussian),
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
        name="gaussian_bytes",
        title="Gaussian, sigma 2, uint8 to uint8",
        image=noise_uint8,
        call=lambda x: cvkern.gaussian(x, SIGMA, dtype="uint8"),
        oracle=lambda x: np.rint(scipy.ndimage.gaussian_filter(x.astype(np.float64), SIGMA)),
        oracle_name="scipy.ndimage.gaussian_filter in float64, rounded",
        difference=relative,
        tolerance=1 / 100,  # float32 may round half a step of one in 177 to the other side
        bytes_per_pixel=2,
        operations_per_pixel=2 * 2 * TAPS,
        peers=(Peer("OpenCV", "cv2", _opencv_gaussian, note="taps of 8 bits"),),
    ),
    Case(
        name="correlate_separable",
        title="15 taps without symmetry, float32",
        image=noise,
        call=lambda x: cvkern.correlate_separable(x, _skewed()),
        oracle=in_float64(_correlate),
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
        oracle=in_float64(_mean),
        oracle_name="scipy.ndimage.uniform_filter in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=8,
        operations_per_pixel=5,  # two running sums and a product
        peers=(
            Peer("OpenCV", "cv2", lambda m, x: m.blur(x, (9, 9), borderType=BORDER_REFLECT)),
            *ndimage_peers(_mean),
            kornia_peers(lambda m, x: m.box_blur(x, (9, 9)))[1],
            Peer("torch", "torch", _torch_mean, "cuda"),
        ),
    ),
)
