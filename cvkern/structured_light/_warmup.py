"""Calls that compile the kernels of structured light."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern import structured_light
from cvkern.structured_light import (
    decode_gray_code,
    decode_phase_shift,
    detect_laser_lines,
    gray_code_patterns,
    phase_shift_patterns,
    unwrap_phase,
)

# Functions that run on the host, or on kernels that the calls below compile.
NO_KERNELS = ("calibrate_projector", "fit_laser_plane", "triangulate_lines")


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every dtype that has own kernels."""
    shape = (6, 9)
    gray, fringes = gray_code_patterns(shape), phase_shift_patterns(shape)
    for dtype in (np.uint8, np.uint16, np.float32):
        light = np.zeros(shape, dtype)
        codes = partial(decode_gray_code, gray.astype(dtype), shape, light, light)
        yield "decode_gray_code", codes
        for method in ("steger", "center_of_mass", "peak"):
            lines = partial(detect_laser_lines, np.eye(9).astype(dtype), method=method)
            yield "detect_laser_lines", lines
        yield "decode_phase_shift", partial(decode_phase_shift, fringes.astype(dtype), shape)
    yield "gray_code_patterns", partial(gray_code_patterns, shape)
    yield "phase_shift_patterns", partial(phase_shift_patterns, shape)
    scan = structured_light.make_scan("phase_shift", shape, shape)
    yield "make_scan", partial(structured_light.make_scan, "laser", shape, shape, frames=1)
    for axis in ("columns", "rows"):
        places = partial(structured_light.triangulate_columns, axis=axis)
        yield "triangulate_columns", partial(places, np.zeros(shape), scan.calibration)
    yield "unwrap_phase", partial(unwrap_phase, np.zeros(shape))
