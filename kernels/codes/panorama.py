"""Constants of panoramas."""

from typing import NamedTuple

NEAR = 1e-9  # least depth of a direction in front of a camera; directions have length 1 or so
NOBODY = -1  # the label of a pixel that no image covers
FAR = 2**30  # the distance of a pixel that no seed reaches
OUTSIDE = -1  # the distance of a pixel that the image does not cover
STRAIGHT, SLANTED = 2, 3  # lengths of steps to neighbours beside and across
LARGEST_COST = 64  # cost of a step where images agree; it is lower where they differ
BLEND_TAPS = (0.0625, 0.25, 0.375, 0.25, 0.0625)  # Burt and Adelson, with a = 0.375


class Part(NamedTuple):
    """A part of a tile, and its place in the image."""

    top: int
    """First row in the tile."""
    left: int
    """First column in the tile."""
    row: int
    """First row in the image."""
    column: int
    """First column in the image."""
    rows: int
    columns: int
