"""The alignment and the surface of each panorama of a heap, before anything is drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    as_items,
    as_numbers,
    check_choice,
    check_flag,
    check_integer,
    check_number,
    check_positive,
)
from cvkern._notices import warn
from cvkern.panorama.models import Alignment, align
from cvkern.panorama.registration import Heap, Link, connected
from cvkern.panorama.surfaces import SURFACES, Canvas, lay_out

MOST_BANDS = 8
LEAST_SCALE = 1e-6  # A panorama is a pixel then; what is farther below has no inverse.


class Options(NamedTuple):
    """Options of a drawing."""

    surface: str
    scale: float
    crop: bool
    compensate: bool
    bands: int | None
    max_pixels: int


def check_options(
    surface: str, scale: float, crop: bool, compensate: bool, bands: int | None, max_pixels: int
) -> Options:
    """Check the options of a drawing, except for the range of `max_pixels`."""
    return Options(
        check_choice(surface, SURFACES, "surface"),
        check_number(check_positive(scale, "scale"), "scale", low=LEAST_SCALE),
        check_flag(crop, "crop"),
        check_flag(compensate, "compensate"),
        bands if bands is None else check_integer(bands, "bands", 0, MOST_BANDS),
        max_pixels,
    )


class Plan(NamedTuple):
    """The alignment and the surface of a panorama, before it is drawn."""

    members: list[int]
    links: list[Link]
    alignment: Alignment
    canvas: Canvas


def check_focals(focal_lengths: Any, count: int) -> np.ndarray | None:
    """Return the focal lengths of so many images as an array, or None."""
    if focal_lengths is None:
        return None
    values = as_numbers(focal_lengths, "focal_lengths")
    if values.shape != (count,):
        raise ValueError(f"focal_lengths must have shape ({count},), got {values.shape}")
    if not (np.isnan(values) | ((values > 0) & np.isfinite(values))).all():
        raise ValueError("focal_lengths must be > 0 and finite, or NaN, got others")
    return values


def check_names(names: Any, count: int) -> list[str]:
    """Return the names of so many images in messages: their indices if `names` is None."""
    if names is None:
        return [str(i) for i in range(count)]
    called = list(as_items(names, "names", "a sequence of strings"))
    if isinstance(names, str) or not all(isinstance(name, str) for name in called):
        raise TypeError(f"names must be a sequence of strings, got {names!r}")
    if len(called) != count:
        raise ValueError(f"names must be as many as the {count} images, got {len(called)}")
    return called


def plan_panoramas(
    heap: Heap,
    links: list[Link],
    focals: np.ndarray | None,
    options: Options,
    called: Sequence[str],
) -> list[Plan]:
    """Align every panorama of the heap, and refuse those that are too large.

    Messages call the images by the names `called`.
    """
    from cvkern.kernels._threads import cpu_threads

    groups = connected(len(heap.images), [(link.first, link.second) for link in links])
    groups = [members for members in groups if len(members) > 1]

    def plan(members: list[int]) -> Plan:
        there = set(members)
        own = [link for link in links if link.first in there]
        return _plan(heap, members, own, focals, options, called)

    # NumPy's work on one panorama leaves processors idle.
    with ThreadPoolExecutor(max(1, min(len(groups), cpu_threads()))) as pool:
        plans = list(pool.map(plan, groups))
    for made in plans:
        if made.alignment.model.endswith("tree"):
            joined = ", ".join(called[i] for i in made.members)
            warn(f"images {joined} could not be adjusted together, and are joined pair by pair")
    return plans


def _plan(
    heap: Heap,
    members: list[int],
    links: list[Link],
    focals: np.ndarray | None,
    options: Options,
    called: Sequence[str],
) -> Plan:
    number = {image: place for place, image in enumerate(members)}
    inner = [k._replace(first=number[k.first], second=number[k.second]) for k in links]
    sides = np.array([heap.images[i].shape[1::-1] for i in members])
    given = None if focals is None or np.isnan(focals[members]).all() else focals[members]
    alignment = align(inner, sides, heap.factors[members], given)
    canvas = lay_out(alignment, sides, options.surface, options.scale)
    size = canvas.width * canvas.height
    if size > options.max_pixels:
        raise ValueError(
            f"max_pixels must be at least the {canvas.width} x {canvas.height} pixels of the "
            f"panorama of images {', '.join(called[i] for i in members)}, got "
            f"{options.max_pixels}: scale makes it smaller, and "
            f"{math.sqrt(options.max_pixels / size) * options.scale:.3g} would do"
        )
    return Plan(members, links, alignment, canvas)
