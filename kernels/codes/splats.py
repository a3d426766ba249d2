"""Codes and constants of Gaussian splats."""

from enum import IntEnum
from typing import Any, NamedTuple

TILE = 16  # side of a tile, pixels
FAINT = 1 / 255  # opacity at a pixel below which a splat is not seen there
MOST = 0.99  # largest opacity at a pixel, so that what is behind keeps a gradient
SHOWN = 12  # numbers of a splat on the screen
SLOPES = 9  # the first ones of these, which have gradients
CULLED = 0x7F800000  # the key of a splat that is not seen: the bits of infinity


class Splats(NamedTuple):
    """N splats, in the coordinates of the frame; kernel arrays, or gradients by them."""

    means: Any
    """(N, 3) float32."""
    turns: Any
    """Quaternions w, x, y, z of any length but 0, (N, 4) float32."""
    scales: Any
    """Logarithms of the standard deviations along the turned axes, (N, 3) float32."""
    opacities: Any
    """Opacities before the logistic function, (N, 1) float32."""
    colors: Any
    """Coefficients of the constant harmonic, (N, 3) float32."""
    sides: Any
    """Those of the other K - 1 harmonics, one after the other, (N, 3 (K - 1)) float32, K = 4, 9 or
    16; (1, 1) if there are none."""


class Sight(NamedTuple):
    """A view of some cameras."""

    poses: Any
    """Camera to frame, (V, 3, 4) float32."""
    lenses: Any
    """fx, fy, cx, cy, k1, k2, p1, p2, k3, (V, 9) float32."""
    view: Any
    """Number of the view, (1,) int32."""
    width: int
    height: int
    near: float
    """Depth below which splats are not seen."""
    blur: float
    """Added to the variance of a splat on the screen, pixels^2."""


class Screen(NamedTuple):
    """Splats on the screen; kernel arrays."""

    shown: Any
    """Column, row, the inverse covariance A, B, C, opacity, red, green, blue; then the distance
    from the camera, and the reach to the left or right, and up or down, (N, 12) float32."""
    boxes: Any
    """Tiles that it meets: first column and row, columns and rows, (N, 4) int32; 0 0 0 0 if none.
    """
    keys: Any
    """The bits of the depth, (N,) int32, or CULLED."""


class Draw(IntEnum):
    """The purpose of a random number; each purpose has its own stream."""

    X = 32  # the way of a splat that wanders
    Y = 34
    Z = 36


class Lists(NamedTuple):
    """The splats of tiles; kernel arrays with room for E entries."""

    order: Any
    """Splats by depth, those of one depth by number, (N,) int32."""
    ranks: Any
    """The places of splats in `order`, (N,) int32."""
    ends: Any
    """Number of entries of the splats of `order` up to this one, (N,) int32.

    An entry is a tile of a splat: entries are numbered splat by splat, in this order, and tile by
    tile, row by row. Those for which there is no room are left out.
    """
    entries: Any
    """The splats of tiles, tile by tile, front to back, (E,) int32."""
    sources: Any
    """The numbers of these entries, (E,) int32."""
    ranges: Any
    """The first of the entries of each tile, and the one after the last, (T + 1,) int32."""


class Tiles(NamedTuple):
    """A picture in tiles, and the splats of each tile."""

    shown: Any
    """That of `Screen`."""
    entries: Any
    sources: Any
    ranges: Any
    """Those of `Lists`."""
    width: int
    height: int
    stop: float
    """The share of light at which a ray ends."""
