"""Histograms made even, of a whole photograph and near each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, Work, relative, skimage_peers


def _grey(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Return a dull picture: soft waves with noise, in the middle of the range."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    waves = np.sin(x / 37) * np.cos(y / 23) + 0.5 * np.sin((x + y) / 90)
    return (120 + 30 * waves + rng.normal(0, 4, shape)).clip(0, 255).astype(np.uint8)


def _even(image: np.ndarray) -> np.ndarray:
    from skimage import exposure

    return exposure.equalize_hist(image)


def _adapted(image: np.ndarray) -> np.ndarray:
    from skimage import exposure

    return exposure.equalize_adapthist(image)


def _opencv(cv2: Any, image: np.ndarray) -> np.ndarray:
    return cv2.createCLAHE(clipLimit=2.56, tileGridSize=(8, 8)).apply(image)


def _in_bytes(name: str, title: str, call: Any, oracle: Any, peer: Any, work: int) -> Case:
    """Return a case that gives bytes, as OpenCV does."""
    return Case(
        name=f"{name}_bytes",
        title=f"{title}, uint8 to uint8",
        image=_grey,
        call=lambda image: call(image, dtype="uint8"),
        oracle=lambda image: np.rint(255 * oracle(image)),
        oracle_name="scikit-image",
        difference=relative,
        tolerance=1.01 / 255,  # some values lie in the middle between two bytes
        bytes_per_pixel=2,
        operations_per_pixel=work,
        peers=(Peer("OpenCV", "cv2", peer),),
        captures=False,
        work=Work("pixels", lambda image: image.size),
        sizes=("1080p",),
    )


CASES = (
    Case(
        name="equalize_hist",
        title="Histogram equalisation, uint8",
        image=_grey,
        call=cvkern.equalize_hist,
        oracle=_even,
        oracle_name="scikit-image",
        difference=relative,
        tolerance=1e-7,  # rounded to float32
        bytes_per_pixel=5,
        operations_per_pixel=4,
        peers=(
            *skimage_peers("exposure", lambda exposure, image: exposure.equalize_hist(image)),
            Peer("OpenCV", "cv2", lambda cv2, image: cv2.equalizeHist(image), note="gives bytes"),
        ),
        captures=False,
        work=Work("pixels", lambda image: image.size),
        sizes=("1080p",),
    ),
    Case(
        name="equalize_adapthist",
        title="CLAHE in 8 x 8 tiles, uint8",
        image=_grey,
        call=cvkern.equalize_adapthist,
        oracle=_adapted,
        oracle_name="scikit-image",
        difference=relative,
        tolerance=2e-7,  # rounded to float32
        bytes_per_pixel=5,
        operations_per_pixel=30,
        peers=(
            *skimage_peers("exposure", lambda exposure, image: exposure.equalize_adapthist(image)),
            Peer("OpenCV", "cv2", _opencv, note="256 tones, gives bytes"),
        ),
        captures=False,
        work=Work("pixels", lambda image: image.size),
        sizes=("1080p",),
    ),
    _in_bytes(
        "equalize_hist", "Histogram equalisation", cvkern.equalize_hist, _even,
        lambda cv2, image: cv2.equalizeHist(image), 4,
    ),
    _in_bytes(
        "equalize_adapthist", "CLAHE in 8 x 8 tiles", cvkern.equalize_adapthist, _adapted,
        _opencv, 30,
    ),
)  # fmt: skip
