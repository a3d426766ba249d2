"""Panoramas from an unordered set of images."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    MAX_ELEMENTS,
    as_numbers,
    check_choice,
    check_flag,
    check_integer,
    check_positive,
)
from cvkern._runtime import Runtime, runtime
from cvkern.features._photographs import white_of
from cvkern.panorama.blending import Blend, blend
from cvkern.panorama.cropping import largest_rectangle
from cvkern.panorama.models import Alignment, align
from cvkern.panorama.recognition import silent
from cvkern.panorama.registration import (
    Heap,
    Link,
    Progress,
    check_heap,
    connected,
    link_images,
    make_small,
)
from cvkern.panorama.seams import Sources, find_seams
from cvkern.panorama.surfaces import SURFACES, Canvas, lay_out

MAX_PIXELS = 100_000_000
MOST_BANDS = 8
LEAST_BAND = 12  # default shorter side of an image in its coarsest band, in pixels


class Panorama(NamedTuple):
    """A panorama, and the alignment of its images."""

    image: Any
    """(H, W) or (H, W, 3): uint8 for uint8 images, uint16 for NumPy's uint16, else float32; 0 where
    there is no image. The array belongs to the same library as the images."""
    mask: Any
    """(H, W) bool: true where there is an image."""
    members: list[int]
    """Indices of the K images, ascending."""
    model: str
    """'rotation': cameras that turn about one point; 'affine' or 'homography': images of one plane;
    'homography tree' or 'similarity tree': images that could not be adjusted jointly and are
    joined pair by pair."""
    surface: str
    """'plane', 'cylinder' or 'sphere'."""
    closed: bool
    """Whether the last column meets the first: a view all round."""
    focal_lengths: np.ndarray
    """(K,) float64, pixels; NaN except for rotations."""
    rotations: np.ndarray
    """(K, 3, 3) float64: from the axes of the panorama (x right, y down, z forward) to the axes of
    each camera; NaN except for rotations."""
    matrices: np.ndarray
    """(K, 3, 3) float64: from (x, y, 1) of a plane panorama to (x, y, 1) of each image; NaN on a
    cylinder or a sphere."""
    gains: np.ndarray
    """(K, C) float32: factors that multiply the colours of each image."""
    residual: float
    """Root mean square distance of the best 85 percent of the matches, in pixels of the images as
    they were compared: at most 0.6 megapixels each."""
    pairs: list[tuple[int, int]]
    """The pairs of members that overlap."""
    lens: float = 0.0
    """How much the lens of rotating cameras bends straight lines: what `matrices` or `rotations`
    bring to p from the middle of an image, in longest sides of all images, is seen at
    ``p (1 + lens |p|^2)``. 0 unless that explains the matches clearly better."""


class Options(NamedTuple):
    """Options of a drawing."""

    surface: str
    scale: float
    crop: bool
    compensate: bool
    bands: int | None
    max_pixels: int


class Plan(NamedTuple):
    """The alignment and the surface of a panorama, before it is drawn."""

    members: list[int]
    links: list[Link]
    alignment: Alignment
    canvas: Canvas


def stitch(
    images: Sequence[Any],
    *,
    surface: str = "auto",
    scale: float = 1.0,
    crop: bool = False,
    compensate: bool = True,
    bands: int | None = None,
    focal_lengths: Any = None,
    max_pixels: int = MAX_PIXELS,
    data_range: float | None = None,
    progress: Progress | None = None,
) -> list[Panorama]:
    """Make every panorama of an unordered set of images.

    The images are grouped as by :func:`recognize_panoramas`. Bundle adjustment finds three angles
    and a focal length for each camera of a group that turned about one point, and how much their
    lens bends straight lines. It finds a homography for each image of one plane, such as the scans
    of a map. Then exposures are equalised, seams are laid around objects that moved, and each
    frequency band of the images is blended over a width of its own. Images that cannot be adjusted
    jointly are joined by the homographies of the best pairs, with a warning.

    Parameters
    ----------
    images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4)
        Images of one real dtype and of any sizes. A fourth channel is ignored.
    surface : {'auto', 'plane', 'cylinder', 'sphere'}, default 'auto'
        The surface for rotating cameras. 'auto' takes a plane for views of up to 90 degrees, corner
        to corner; else a cylinder for views of up to 50 degrees above and below the horizon; else
        a sphere. No plane holds more than 150 degrees: 'plane' then acts like 'auto'. Images of a
        plane are always drawn on a plane.
    scale : float, default 1.0
        Pixels of the panorama per pixel of an image.
    crop : bool, default False
        Cut the panorama to the largest rectangle without gaps.
    compensate : bool, default True
        Multiply each colour of each image by a gain that equalises the overlaps.
    bands : int, optional
        Number of times that images are halved for blending, at most 8; 0 gives hard seams. By
        default the smallest image is about 12 pixels wide.
    focal_lengths : array of shape (N,), optional
        Focal lengths of the images, in their pixels, if known to about 5 percent; NaN for unknown
        ones. They are refined, and ignored if the matches contradict them.
    max_pixels : int, default 100000000
        A larger panorama is refused before anything is drawn.
    data_range : float, optional
        The value of white. By default the largest number of an integer dtype, else 1.
    progress : function, optional
        Called with the number of completed steps, the number of all steps, and the name of the next
        one.

    Returns
    -------
    list of Panorama
        The panoramas, sorted by their number of images, largest first, then by their least index.
        Images without partners are left out.

    Raises
    ------
    TypeError
        If an image does not hold real numbers.
    ValueError
        If there are no images, one is empty or of another shape, their dtypes differ, the arrays
        are on several devices, an option is out of its range, or a panorama would have more than
        `max_pixels`.

    Warns
    -----
    UserWarning
        If images of a panorama could not be adjusted jointly.

    References
    ----------
    .. [1] M. Brown and D. Lowe, "Automatic panoramic image stitching using invariant features",
       IJCV 74(1), 2007.
    .. [2] P. Burt and E. Adelson, "A multiresolution spline with application to image mosaics",
       ACM Transactions on Graphics 2(4), 1983.

    Examples
    --------
    >>> from skimage import data
    >>> import cvkern
    >>> wide = data.coffee()
    >>> (panorama,) = cvkern.stitch([wide[:, 250:], data.camera()[..., None], wide[:, :350]])
    >>> panorama.members, panorama.surface, panorama.image.shape
    ([0, 2], 'plane', (400, 600, 3))
    """
    checked = check_heap(images, data_range)
    kinds = {library(image).dtype(image) for image in checked}
    if len(kinds) > 1:
        names = ", ".join(sorted(map(str, kinds)))
        raise ValueError(f"images must be of one dtype, got {names}")
    options = Options(
        check_choice(surface, SURFACES, "surface"),
        check_positive(scale, "scale"),
        check_flag(crop, "crop"),
        check_flag(compensate, "compensate"),
        bands if bands is None else check_integer(bands, "bands", 0, MOST_BANDS),
        check_integer(max_pixels, "max_pixels", 1, MAX_ELEMENTS),
    )
    focals = _check_focals(focal_lengths, len(checked))
    say = progress or silent
    heap = make_small(checked, data_range)
    plans = _planned(heap, focals, options, say)
    rt = runtime(*checked)
    found = []
    for number, plan in enumerate(plans):
        text = f"Panorama {number + 1} of {len(plans)}"

        def part(done: float, number: int = number, text: str = text) -> None:
            say(2 * len(checked) + int(100 * (number + done)), 2 * len(checked) + 100 * len(plans),
                text)  # fmt: skip

        found.append(_drawn(rt, heap, plan, options, part))
    return found


def _check_focals(focal_lengths: Any, count: int) -> np.ndarray | None:
    if focal_lengths is None:
        return None
    values = as_numbers(focal_lengths, "focal_lengths")
    if values.shape != (count,):
        raise ValueError(f"focal_lengths must have shape ({count},), got {values.shape}")
    if not (np.isnan(values) | ((values > 0) & np.isfinite(values))).all():
        raise ValueError("focal_lengths must be > 0 and finite, or NaN, got others")
    return values


def _planned(heap: Heap, focals: np.ndarray | None, options: Options, say: Progress) -> list[Plan]:
    """Align every panorama of the heap, and refuse those that are too large."""
    from cvkern.kernels._threads import cpu_threads

    links = link_images(heap, say)
    groups = connected(len(heap.images), [(link.first, link.second) for link in links])
    groups = [members for members in groups if len(members) > 1]

    def plan(members: list[int]) -> Plan:
        own = [link for link in links if link.first in members]
        return _plan(heap, members, own, focals, options)

    # NumPy's work on one panorama leaves processors idle.
    with ThreadPoolExecutor(max(1, min(len(groups), cpu_threads()))) as pool:
        plans = list(pool.map(plan, groups))
    for made in plans:
        if made.alignment.model.endswith("tree"):
            names = ", ".join(map(str, made.members))
            warnings.warn(
                f"images {names} could not be adjusted together, and are joined pair by pair",
                stacklevel=3,
            )
    return plans


def _plan(
    heap: Heap, members: list[int], links: list[Link], focals: np.ndarray | None, options: Options
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
            f"panorama of images {', '.join(map(str, members))}, got {options.max_pixels}: scale "
            f"makes it smaller, and {math.sqrt(options.max_pixels / size) * options.scale:.3g} "
            "would do"
        )
    return Plan(members, links, alignment, canvas)


def _drawn(rt: Runtime, heap: Heap, plan: Plan, options: Options, say: Any) -> Panorama:
    """Draw a panorama."""
    canvas, members, alignment = plan.canvas, plan.members, plan.alignment
    images = [heap.images[i] for i in members]
    colour = any(len(image.shape) == 3 and image.shape[2] > 1 for image in images)
    white = white_of(images[0], heap.white)
    dtype = library(images[0]).dtype(images[0])
    channels = 3 if colour else 1
    say(0.0)
    small = Sources([heap.small[i] for i in members], heap.factors[members], white, channels)
    seams = find_seams(rt, canvas, small, options.compensate)
    sides = np.array([image.shape[:2] for image in images], np.int32)
    smallest = max(1.0, float(sides.min()) * options.scale)
    wanted = round(math.log2(smallest / LEAST_BAND)) if options.bands is None else options.bands
    bands = max(0, min(wanted, int(math.log2(smallest)), MOST_BANDS))
    high = float(np.iinfo(dtype).max) if dtype in (np.uint8, np.uint16) else 0.0
    made = np.uint8 if dtype == np.uint8 else np.float32
    shape = canvas.height, canvas.width
    image, mask = rt.empty((*shape, channels) if colour else shape, made), rt.empty(shape, bool)
    blend(
        rt, canvas, seams, Blend(images, sides, bands, high, channels),
        rt.adopt(image, made, shape=(*shape, channels)), rt.adopt(mask, bool),
        lambda done: say(0.2 + 0.8 * done),
    )  # fmt: skip
    image, mask = rt.release(image), rt.release(mask)
    if dtype == np.uint16 and isinstance(image, np.ndarray):
        image = image.astype(np.uint16)
    matrices = canvas.matrices
    origin = np.array([[canvas.step, 0, canvas.left], [0, canvas.step, canvas.top], [0, 0, 1]])
    if options.crop:
        host = mask if isinstance(mask, np.ndarray) else rt.to_numpy(rt.adopt(mask, bool))
        top, left, bottom, right = largest_rectangle(np.asarray(host) != 0)
        of = library(image)
        image, mask = (of.contiguous(a[top:bottom, left:right], of.dtype(a)) for a in (image, mask))
        origin = origin @ np.array([[1, 0, left], [0, 1, top], [0, 0, 1]])
    flat = canvas.surface == "plane"
    count = len(members)
    none = np.full((count, 3, 3), np.nan)
    placed = matrices @ origin
    return Panorama(
        image, mask, members, alignment.model, canvas.surface,
        canvas.closed and image.shape[1] == canvas.width,
        alignment.focals if alignment.focals is not None else np.full(count, np.nan),
        canvas.rotations if canvas.rotations is not None else none,
        placed / placed[:, 2:, 2:] if flat else none, seams.gains, alignment.residual,
        [(link.first, link.second) for link in plan.links],
        alignment.bend * float(max(max(image.shape[:2]) for image in images)) ** 2,
    )  # fmt: skip
