"""What a panorama is drawn from, and the result that describes it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._runtime import Runtime
from cvkern.panorama.blending import Blend
from cvkern.panorama.planning import MOST_BANDS, Options, Plan
from cvkern.panorama.registration import Heap
from cvkern.panorama.seams import Seams, Sources, find_seams

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


class Drawing(NamedTuple):
    """The seams of a panorama, and the kind of its pixels."""

    seams: Seams
    blend: Blend
    dtype: Any
    """The dtype of the images; kernels make uint8 or float32."""
    colour: bool

    @property
    def made(self) -> Any:
        """The dtype that kernels write."""
        return np.uint8 if self.dtype == np.uint8 else np.float32

    @property
    def channels(self) -> tuple[int, ...]:
        """The axis of the channels in the shape of the panorama."""
        return (3,) if self.colour else ()


def prepare(rt: Runtime, heap: Heap, plan: Plan, options: Options) -> Drawing:
    """Find the seams and the gains of a panorama."""
    members = plan.members
    images = [heap.images[i] for i in members]
    colour = any(len(image.shape) == 3 and image.shape[2] > 1 for image in images)
    white = max(heap.whites[i] for i in members)
    dtype = library(images[0]).dtype(images[0])
    channels = 3 if colour else 1
    small = Sources([heap.small[i] for i in members], heap.factors[members], white, channels)
    seams = find_seams(rt, plan.canvas, small, options.compensate)
    sides = np.array([image.shape[:2] for image in images], np.int32)
    smallest = max(1.0, float(sides.min()) * options.scale)
    wanted = round(math.log2(smallest / LEAST_BAND)) if options.bands is None else options.bands
    bands = max(0, min(wanted, int(math.log2(smallest)), MOST_BANDS))
    high = float(np.iinfo(dtype).max) if dtype in (np.uint8, np.uint16) else 0.0
    return Drawing(seams, Blend(images, sides, bands, high, channels), dtype, colour)


def panorama_of(
    plan: Plan, drawing: Drawing, image: Any, mask: Any, corner: tuple[int, int] = (0, 0)
) -> Panorama:
    """Return the result for a drawn panorama; `corner` is where the part that is kept begins."""
    canvas, alignment = plan.canvas, plan.alignment
    origin = np.array([[canvas.step, 0, canvas.left], [0, canvas.step, canvas.top], [0, 0, 1]])
    origin = origin @ np.array([[1, 0, corner[1]], [0, 1, corner[0]], [0, 0, 1]])
    count = len(plan.members)
    none = np.full((count, 3, 3), np.nan)
    placed = canvas.matrices @ origin
    return Panorama(
        image, mask, plan.members, alignment.model, canvas.surface,
        canvas.closed and image.shape[1] == canvas.width,
        alignment.focals if alignment.focals is not None else np.full(count, np.nan),
        canvas.rotations if canvas.rotations is not None else none,
        placed / placed[:, 2:, 2:] if canvas.surface == "plane" else none,
        drawing.seams.gains, alignment.residual,
        [(link.first, link.second) for link in plan.links],
        alignment.bend * float(drawing.blend.sides.max()) ** 2,
    )  # fmt: skip
