"""Codes of colours that the API and the kernel sets share."""

import math
from enum import IntEnum


class Form(IntEnum):
    """How three numbers tell a colour, beside a matrix."""

    LINEAR = 0
    SRGB = 1  # the curve of IEC 61966-2-1
    LAB = 2
    LCH = 3


# The curves of sRGB and CIE L*a*b*.
SRGB_LOW, SRGB_SLOPE, SRGB_SHIFT, SRGB_SCALE, SRGB_POWER = 0.0031308, 12.92, 0.055, 1.055, 2.4
LAB_LOW, LAB_SLOPE, LAB_SHIFT = 216 / 24389, 24389 / 27 / 116, 16 / 116
DEGREES = 180 / math.pi  # degrees a radian
BLUE = 25.0**7  # seventh power of the chroma about which CIEDE2000 changes
# 8-bit sRGB steps up at most once between numbers whose upper 16 bits differ by 1, above DARKEST.
DARKEST = 2.0**-13
FIRST = 0x3900  # upper half of the bits of DARKEST
STEPS = 0x3F80 - FIRST + 1  # up to those of 1
LEVELS = 2**16  # brightness of 16 bits, which histograms equalise
TONES = 2**14  # tones that tiles map brightness to
SATURATED = 0.98  # share of the largest value, which no channel of a pixel may reach
SLOTS = 1024  # maxima that are compared on the host
