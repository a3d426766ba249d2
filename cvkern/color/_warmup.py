"""Calls that compile the kernels of colour."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.color import (
    adapt_colors,
    convert_color,
    deltaE_ciede2000,
    equalize_adapthist,
    equalize_hist,
    estimate_illuminant,
    metameric_difference,
    retinex,
    spectrum_to_xyz,
    white_balance,
)

# Functions that run on the host, or on kernels that the calls below compile.
NO_KERNELS = (
    "adaptation_matrix", "color_chart", "illusion", "lateral_inhibition", "metamer",
    "standard_light", "standard_observer",
)  # fmt: skip


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function that has own kernels."""
    image = np.full((6, 8, 3), 0.5, np.float32)
    yield "convert_color", partial(convert_color, image, "srgb", "lab")
    yield "convert_color", partial(convert_color, image, "rgb", "srgb", dtype=np.uint8)
    yield "adapt_colors", partial(adapt_colors, image, "D65", "D50")
    yield "white_balance", partial(white_balance, image, (1, 1, 1))
    yield "estimate_illuminant", partial(estimate_illuminant, image)
    yield "deltaE_ciede2000", partial(deltaE_ciede2000, image, image)
    yield "spectrum_to_xyz", partial(spectrum_to_xyz, np.ones((2, 81)))
    grey = np.full(81, 0.5)
    yield "metameric_difference", partial(metameric_difference, grey, grey)
    yield "equalize_hist", partial(equalize_hist, image)
    yield "equalize_adapthist", partial(equalize_adapthist, image)
    yield "retinex", partial(retinex, image, 2.0)
    yield "retinex", partial(retinex, image, method="gradients")
