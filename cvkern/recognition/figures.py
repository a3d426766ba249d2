"""What was found in a picture: boxes, and figures that follow votes back to masks of training."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import Frame, Occurrences, Patches
from cvkern.recognition.votes import Hall

if TYPE_CHECKING:
    from cvkern.recognition.search import Found

PAINTED = 16  # figures that are painted before the host knows how many there are


class Objects(NamedTuple):
    """Objects that a model found, the strongest first."""

    boxes: Any
    """First row and column, and those behind the last, (N, 4) float32."""
    scores: Any
    """Logarithm of the odds that there is an object, (N,) float32."""
    centers: Any
    """Row and column of the middle, (N, 2) float32."""
    scales: Any
    """Size, in sizes of the model, (N,) float32."""


class Segmentation(NamedTuple):
    """Objects that a model found, and their pixels."""

    objects: Objects
    masks: Any
    """Pixels of each object, (N, H, W) bool."""


class Painter(NamedTuple):
    """What figures are painted with, for kernels."""

    rt: Runtime
    patches: Patches
    occurrences: Occurrences
    hall: Hall
    frame: Frame
    figures: Any
    balance: Any
    """Room for the boxes of figures (T, H, W) int32."""

    def paint(self, modes: Any) -> None:
        """Paint the figures of the first T modes."""
        rt, patches, occurrences, hall, frame, figures, balance = self
        rt.recognition.figures.paint_figures(
            patches, occurrences, hall.space, hall.window, frame, figures, modes, balance
        )


def masks_of(found: Found) -> Any:
    """Return the masks (N, H, W) of the objects, in the caller's library."""
    rt, painter = found.rt, found.painter
    masks = rt.empty((found.number, *found.shape), np.bool_)
    if painter is not None and found.number:
        if found.number > PAINTED:
            shape = found.number, *painter.balance.shape[1:]
            painter = painter._replace(balance=rt.scratch("recognition.painted", shape, np.int32))
            painter.paint(found.modes)
        rt.recognition.figures.spread_figures(
            painter.balance, found.modes, found.hall.space, rt.adopt(masks, np.bool_)
        )
    return rt.release(masks)


def objects_of(found: Found, bias: int) -> Objects:
    """Return the objects that were found, in pixels."""
    rt, count = found.rt, found.number
    shapes = (count, 4), (count,), (count, 2), (count,)
    if not count:
        return Objects(*(rt.give(np.empty(shape, np.float32)) for shape in shapes))
    described = [rt.empty(shape) for shape in shapes]
    rt.recognition.figures.describe_objects(
        found.modes, found.hall.sizes, found.hall.space.lowest, bias,
        *(rt.adopt(array) for array in described),
    )  # fmt: skip
    return Objects(*(rt.release(array) for array in described))
