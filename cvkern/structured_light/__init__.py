"""Structured light: patterns, and what photographs of them say of a projector's coordinates."""

from cvkern.structured_light.gray_code import GrayCode, decode_gray_code
from cvkern.structured_light.laser import LaserLines, detect_laser_lines
from cvkern.structured_light.patterns import gray_code_patterns, phase_shift_patterns
from cvkern.structured_light.phase import PhaseShift, decode_phase_shift
from cvkern.structured_light.unwrapping import unwrap_phase

__all__ = [
    "GrayCode",
    "LaserLines",
    "PhaseShift",
    "decode_gray_code",
    "decode_phase_shift",
    "detect_laser_lines",
    "gray_code_patterns",
    "phase_shift_patterns",
    "unwrap_phase",
]
