"""From linear values to what a screen shows."""

from __future__ import annotations

import numpy as np

import cvkern
from profiling.case import Case, Shape, Work, relative
from tests.color import reference_color as reference


def _image(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    return rng.random((*shape, 3)).astype(np.float32)


def _codes(image: np.ndarray) -> np.ndarray:
    return np.rint(reference.srgb_curve(image.astype(np.float64)) * 255)


def _lab(image: np.ndarray) -> np.ndarray:
    matrix, white = reference.rgb_to_xyz()
    return reference.lab(image.astype(np.float64) @ matrix.T, white)


CASES = (
    Case(
        name="rgb_to_srgb8",
        title="Linear RGB to 8-bit sRGB",
        image=_image,
        call=lambda image: cvkern.convert_color(image, "rgb", "srgb", dtype=np.uint8),
        oracle=_codes,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=1.01 / 255,
        bytes_per_pixel=15,
        operations_per_pixel=24,
        work=Work("pixels", lambda image: image.size // 3),
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="rgb_to_lab",
        title="Linear RGB to L*a*b*",
        image=_image,
        call=lambda image: cvkern.convert_color(image, "rgb", "lab"),
        oracle=_lab,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=2e-6,
        bytes_per_pixel=24,
        operations_per_pixel=90,
        work=Work("pixels", lambda image: image.size // 3),
        sizes=("1080p",),
        margin=0,
    ),
)
