"""From the samples of a Bayer filter to three colours at each pixel."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, Work, relative
from tests.raw import reference_demosaicing as reference

INNER = np.s_[36:-36, 36:-36]  # borders are mirrored otherwise by each
# Rounding to integers, as a share of the largest value, at least 100. Weights of lines in float32
# make as much again.
ROUNDED = 0.51 / 100


def _raw(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Return the mosaic of soft colours with noise."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    waves = [np.sin(x / (9 + 4 * k)) * np.cos(y / (7 + 3 * k)) for k in range(3)]
    image = 120 + 90 * np.stack(waves, axis=-1) + rng.normal(0, 3, (*shape, 3))
    return cvkern.mosaic(image.clip(0, 255).astype(np.uint8))


def _opencv(code: str, cv2: Any, raw: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(raw, getattr(cv2, code))[INNER]


def _case(method: str, operations: int, peers: tuple[Peer, ...]) -> Case:
    return Case(
        name=f"demosaic_{method}",
        title=f"Demosaicing, {method}, uint8",
        image=_raw,
        call=lambda raw: cvkern.demosaic(raw, method=method)[INNER],
        oracle=lambda raw: getattr(reference, method)(raw, "RGGB").clip(0, 255)[INNER],
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=ROUNDED if method != "residual" else 2 * ROUNDED,
        bytes_per_pixel=4,
        operations_per_pixel=operations,
        peers=peers,
        work=Work("pixels", lambda raw: raw.size),
        sizes=("1080p",),
        margin=0,
    )


CASES = (
    _case("bilinear", 12, (Peer("OpenCV", "cv2", partial(_opencv, "COLOR_BayerRGGB2RGB")),)),
    _case("malvar", 36, ()),
    _case(
        "menon",
        150,
        (Peer("OpenCV, edge-aware", "cv2", partial(_opencv, "COLOR_BayerRGGB2RGB_EA")),),
    ),
    _case("residual", 700, ()),
)
