"""Constants of structured light, and the arguments of decoding."""

from typing import Any, NamedTuple

NONE = -1  # the code of a pixel that saw no pattern
MOST_MOVES = 6  # largest distance in pixels of a ridge from the brightest position
LEAST_BEND = 1e-18  # smaller second derivatives count as 0, for their squares are denormal
MOST_OFFSET = 0.75  # largest distance in pixels of a ridge from the middle of its pixel

LENS_STEPS = 4  # Newton's steps to the point on a column that the projector's lens bends
STILL = 1e-4  # a shorter step of Newton's is the last: its square is below a rounding
NEAR = 1e-3  # largest distance from that column before the last step, of a focal length of 1


class Fringes(NamedTuple):
    """The fringes along an axis, and the pixels that count."""

    frequencies: Any
    """Periods along the axis, in ascending order, (F,) float32."""
    waves: Any
    """Sine and cosine of the phase of each step, (N, 2) float32."""
    size: int
    """Lines of the projector along the axis."""
    threshold: float
    """A pixel is valid if its least modulation is above this."""
    joins: bool
    """Whether a pixel must have been valid before as well."""


class Decoded(NamedTuple):
    """Arrays (H, W) of the decoding of an axis."""

    places: Any
    """Place along the axis, in lines of the projector, float32."""
    phases: Any
    """Phase of the last frequency, radians, float32."""
    modulations: Any
    """Least modulation of all frequencies, float32."""
    valid: Any
    """uint8; read before it is written if `joins`."""
