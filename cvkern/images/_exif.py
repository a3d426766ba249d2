"""The focal length of a photograph, from the EXIF tags of its file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

EXIF, LENGTH, LENGTH_35MM, WIDTH, HEIGHT = 0x8769, 0x920A, 0xA405, 0xA002, 0xA003
DENSITY, DENSITY_UNIT = 0xA20E, 0xA210
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0}  # per unit of the density: inch, cm, mm
FILM_DIAGONAL = math.hypot(36.0, 24.0)
SAME_SHAPE = 0.01  # relative difference of aspect ratios above which a picture was cropped


def focal_length(path: Path, shape: tuple[int, ...]) -> float | None:
    """Return the focal length of a photograph in its pixels, or None if its file does not tell.

    `shape` is that of the pixels. A picture that was cropped since it was taken tells nothing.
    """
    from PIL import Image

    try:
        with Image.open(path) as file:
            tags = file.getexif().get_ifd(EXIF)
            sides = [_number(tags.get(tag)) for tag in (WIDTH, HEIGHT)]
            film, length = _number(tags.get(LENGTH_35MM)), _number(tags.get(LENGTH))
            density, unit = _number(tags.get(DENSITY)), tags.get(DENSITY_UNIT, 2)
    except Exception:  # readers raise many types; a file without tags is no error
        return None
    short, long = sorted(shape[:2])
    taken = sorted(s for s in sides if s)
    if len(taken) == 2 and abs(taken[1] / taken[0] / (long / short) - 1) > SAME_SHAPE:
        return None
    if film:
        return film / FILM_DIAGONAL * math.hypot(long, short)
    if length and density and unit in MILLIMETRES and len(taken) == 2:
        return length * density / MILLIMETRES[unit] * long / taken[1]
    return None


def _number(value: Any) -> float | None:
    """Return a number above 0, or None."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None
