"""Tables in fixed point that map points to the bins of an accumulator of lines."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._checks import MAX_ELEMENTS
from cvkern._runtime import Runtime, refuse_capture
from cvkern.hough._points import Points
from cvkern.kernels.codes.hough import DIRECTIONS, LineTables, LineWindows

SUBPIXEL = 4096  # sub-pixel points are rounded to this fraction of a pixel
WEIGHT = 256  # a weight of 1, in votes
_ANGLES = 8  # tables are padded to a multiple of this, because kernels take this many at a time
_NOTHING = 1e-9  # radians: angles that differ by less are equal


def cast_votes(
    rt: Runtime,
    found: Points,
    tables: LineTables,
    windows: tuple[np.ndarray, np.ndarray] | None,
    orientation: Any,
    weights: Any,
    crossing: int,
    votes: Any,
) -> None:
    """Fill the kernel array `votes`; orientation and weights are images, or lists like the points.

    `crossing` is the largest number of pixels of an image that fall into one bin.
    """
    fixed = None if weights is None else _fixed_weights(rt, found, weights, crossing)
    listed = kernel_tables(rt, tables)
    if windows is None:
        rt.hough.lines.votes.vote(found.points, found.starts, listed, fixed, votes)
        return
    directions = values_at(rt, found, orientation, "orientation")
    check_listed(rt, found, directions, "orientation", -math.inf)
    allowed = LineWindows(directions, *map(rt.constant, windows))
    rt.hough.lines.votes.vote_directed(found.points, found.starts, allowed, listed, fixed, votes)


def kernel_tables(rt: Runtime, tables: LineTables) -> LineTables:
    """Return the tables as kernel arrays."""
    cosine, sine, offset = (rt.constant(table) for table in tables[:3])
    return LineTables(cosine, sine, offset, tables.shift)


def values_at(rt: Runtime, found: Points, values: Any, name: str) -> Any:
    """Return a float32 kernel list of values at the points; `values` is an image or a list."""
    if len(values.shape) == 1:
        return rt.adopt(values) if len(values) else rt.scratch(f"lines.{name}", (1,))
    taken = rt.scratch(f"lines.{name}", (max(found.capacity, 1),))
    image = rt.adopt(values, shape=(found.height, values.shape[-1]))
    rt.hough.lines.votes.take(found.points, found.starts, image, taken)
    return taken


def check_listed(rt: Runtime, found: Points, listed: Any, name: str, low: float) -> np.ndarray:
    """Return the list on the host, checked to be finite and at least `low`."""
    refuse_capture(f"{name}, whose values are checked")
    number = int(rt.to_numpy(found.starts)[-1])
    host = rt.to_numpy(listed[: max(number, 1)])[:number]  # a GPU's list may be far longer
    wrong = ~(np.isfinite(host) & (host >= low))
    if wrong.any():
        i = int(wrong.argmax())
        rule = "finite" if low == -math.inf else f">= {low:g} and finite"
        raise ValueError(
            f"{name} must be {rule} at the points, got {host[i]:g} at point {i} of {number}"
        )
    return host


def _fixed_weights(rt: Runtime, found: Points, weights: Any, crossing: int) -> Any:
    """Return a kernel list of weights as votes, so small that no bin overflows int32."""
    listed = check_listed(rt, found, values_at(rt, found, weights, "weights"), "weights", 0)
    fixed = np.floor(listed.astype(np.float64) * WEIGHT + 0.5)
    most = fixed.sum()
    if len(weights.shape) > 1 and len(fixed):
        ends = rt.to_numpy(found.starts)[:: weights.shape[-2]]  # points of each image
        most = np.diff(np.concatenate(([0], np.cumsum(fixed)))[ends]).max()
        most = min(most, fixed.max() * crossing)
    if most >= 2**31:
        raise ValueError(
            f"weights must be small enough for votes below 2^31, got up to {listed.max():g}"
        )
    return rt.send("lines.votes", (fixed if len(fixed) else np.zeros(1)).astype(np.int32))


def subpixel_points(rt: Runtime, points: Any, size: tuple[int, int]) -> Points:
    """Return checked (N, 2) points in fixed point."""
    refuse_capture("points, whose values are checked")
    host = rt.to_numpy(rt.adopt(points)) if len(points) else np.zeros((0, 2), np.float32)
    outside = ~((host >= -0.5) & (host <= np.array(size) - 0.5)).all(axis=1)
    if outside.any():
        raise ValueError(
            f"points must lie within the image of shape {tuple(size)}, "
            f"got ({', '.join(f'{v:g}' for v in host[outside.argmax()])})"
        )
    number = len(host)
    fixed = np.zeros((max(number, 1), 2), np.int32)
    fixed[:number] = np.floor(host.astype(np.float64) * SUBPIXEL + 0.5)
    count = rt.send("lines.count", np.array([number], np.int32))
    return Points(rt.send("lines.fixed", fixed), count, number, 0)


def reach(size: tuple[int, int], step: float) -> int:
    """Return the number of bins of rho on each side of 0."""
    # The quotient may be infinite; no accumulator has more than MAX_ELEMENTS bins.
    return math.ceil(min(math.sqrt(size[0] ** 2 + size[1] ** 2) / step, MAX_ELEMENTS))


def crossing(size: tuple[int, int], step: float) -> int:
    """Return the largest number of pixels of a line that fall into one bin."""
    # A line has at most one side of the image, times those per row.
    return max(size) * (math.floor(math.sqrt(2) * step) + 1)


@lru_cache(maxsize=32)
def line_tables(angles: bytes, step: float, size: tuple[int, int], parts: int) -> LineTables:
    """Return the tables for float64 angles, and for points in units of 1 / `parts` of a pixel."""
    theta = np.frombuffer(angles)
    return fixed_tables(np.cos(theta) / step, np.sin(theta) / step, reach(size, step), size, parts)


def moved(tables: LineTables, corner: tuple[int, int]) -> LineTables:
    """Return the tables for points that are counted from the pixel `corner` of the image."""
    y, x = corner
    offset = tables.offset + y * tables.sine.astype(np.int64) + x * tables.cosine.astype(np.int64)
    return tables._replace(offset=offset)


def fixed_tables(
    cosine: np.ndarray, sine: np.ndarray, constant: Any, size: tuple[int, int], parts: int = 1
) -> LineTables:
    """Return tables for the bin nearest to ``x cosine + y sine + constant``.

    The factors have as many bits as int32 holds, and sums have at most 62 bits. The offset removes
    the effect of the factors' rounding at the centre of the image; it is largest at the corners.
    """
    largest = max(np.abs(cosine).max(), np.abs(sine).max())
    farthest = (
        float(np.max(np.abs(constant))) + sum(size) * largest + 1
    )  # the largest number of a bin
    digits = math.floor(math.log2((2**31 - 1) / max(largest, 1e-290)))
    room = 62 - (parts.bit_length() - 1) - math.frexp(farthest)[1]
    shift = min(digits, room)
    if shift < 0:
        raise ValueError(f"intercepts must be at least 2^-31 apart, got {1 / largest:g}")
    c, s = (np.round(v * 2.0**shift).astype(np.int64) for v in (cosine, sine))
    y, x = (n // 2 for n in size)
    middle = np.round((x * cosine + y * sine + constant + 0.5) * 2.0**shift).astype(np.int64)
    fill = (0, -len(c) % _ANGLES)
    return LineTables(
        np.pad(c, fill).astype(np.int32),
        np.pad(s, fill).astype(np.int32),
        np.pad((middle - x * c - y * s) * parts, fill),
        shift + parts.bit_length() - 1,
    )


@lru_cache(maxsize=32)
def direction_windows(angles: bytes, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the first angle, and the number of angles, that each direction code votes for.

    Codes cover half a turn, and the angles form a ring. If no angle is within the tolerance, the
    nearest one is taken (the smaller of two), unless it is further away than half the widest gap
    between neighbours. Then the angles do not cover that direction.
    """
    theta = np.frombuffer(angles)
    if np.any(np.diff(theta) <= 0) or theta[-1] - theta[0] >= math.pi:
        raise ValueError(
            "theta must ascend, over less than half a turn, where orientation is given, "
            f"got {len(theta)} angles from {theta[0]:g} to {theta[-1]:g}"
        )
    codes = DIRECTIONS // 2
    ring = np.concatenate([theta - math.pi, theta, theta + math.pi])
    direction = theta[0] + np.mod(np.arange(codes) * (math.pi / codes) - theta[0], math.pi)
    reach = min(tolerance, math.pi / 2) + _NOTHING
    first = np.searchsorted(ring, direction - reach, "left")
    number = np.minimum(np.searchsorted(ring, direction + reach, "right") - first, len(theta))
    after = np.searchsorted(ring, direction)
    gaps = direction - ring[after - 1], ring[after] - direction
    gap = max(np.diff(theta).max(initial=0.0), math.pi if len(theta) == 1 else 0.0)
    nearest = np.where(gaps[0] <= gaps[1] + _NOTHING, after - 1, after)
    alone = (number < 1) & (np.minimum(*gaps) <= gap / 2 + _NOTHING)
    first = np.where(number < 1, nearest, first) % len(theta)
    return first.astype(np.int32), np.where(alone, 1, number).astype(np.int32)
