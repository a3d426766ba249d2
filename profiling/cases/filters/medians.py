"""Rank filters: the median."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from profiling.arrays import noise_uint8
from profiling.case import Case, Peer, kornia_peers, ndimage_peers, unequal


def _median(m: Any, x: Any, xp: Any) -> Any:
    return m.median_filter(x, 5, mode="nearest")


CASES = (
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
)
