"""Structured light: patterns, decoding to projector coordinates, and triangulation."""

from cvkern.structured_light.gray_code import GrayCode, decode_gray_code
from cvkern.structured_light.laser import LaserLines, detect_laser_lines
from cvkern.structured_light.patterns import gray_code_patterns, phase_shift_patterns
from cvkern.structured_light.phase import PhaseShift, decode_phase_shift
from cvkern.structured_light.scans import Scan, make_scan
from cvkern.structured_light.triangulation import (
    calibrate_projector,
    fit_laser_plane,
    triangulate_columns,
    triangulate_lines,
)
from cvkern.structured_light.unwrapping import unwrap_phase

__all__ = [
    "GrayCode",
    "LaserLines",
    "PhaseShift",
    "Scan",
    "calibrate_projector",
    "decode_gray_code",
    "decode_phase_shift",
    "detect_laser_lines",
    "fit_laser_plane",
    "gray_code_patterns",
    "make_scan",
    "phase_shift_patterns",
    "triangulate_columns",
    "triangulate_lines",
    "unwrap_phase",
]
