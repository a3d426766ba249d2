"""The set pixels of a mask as a list in kernel memory, from which the Hough transforms vote."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_image, check_integer, check_sides
from cvkern._runtime import Runtime, refuse_capture


class Points(NamedTuple):
    """Kernel arrays. The number of points is `starts[height]`; the host need not know it."""

    points: Any
    """Row and column of the set pixels in raster order, (at least `capacity`, 2) int32."""
    starts: Any
    """The number of set pixels above each row, then of all rows, (height + 1,) int32."""
    capacity: int
    """The number of points on the CPU; on CUDA the number of pixels, so the host need not wait."""
    height: int


def check_masks(mask: Any, batch_axis: int | None) -> tuple[Any, tuple[int, int]]:
    """Return a mask (H, W), or with `batch_axis` 0 a stack (N, H, W), and its sides."""
    if batch_axis is not None:
        check_integer(batch_axis, "batch_axis", 0, 0)
    mask = check_image(mask, ndim=(2,) if batch_axis is None else (3,), name="mask")
    return mask, check_sides(tuple(mask.shape)[-2:], "mask")


def mask_points(rt: Runtime, mask: Any, name: str) -> Points:
    """List the set pixels of a checked mask; valid until this thread asks for `name` again.

    Of a stack of masks (N, H, W), the rows are numbered through all images.
    """
    *shape, width = mask.shape
    height = math.prod(shape)
    view = rt.adopt_mask(mask).reshape((height, width))
    starts = rt.scratch(f"{name}.starts", (height + 1,), np.int32)
    rt.hough.points.count(view, starts)
    capacity = int(rt.host_view(starts)[-1]) if rt.device == "cpu" else height * width
    points = rt.scratch(f"{name}.points", (max(capacity, 1), 2), np.int32)
    if capacity:
        rt.hough.points.gather(view, starts, points)
    return Points(points, starts, capacity, height)


def check_at_points(
    rt: Runtime, found: Points, values: Any, name: str, low: float, high: float = math.inf
) -> None:
    """Refuse float32 kernel `values` that are NaN or outside [low, high] at a point.

    They are (H, W), or (N, H, W) of a stack.

    The host waits for the result, so :func:`cvkern.capture` cannot record this.
    """
    refuse_capture(f"{name}, whose values are checked")
    if not found.capacity:
        return
    index = rt.scratch("points.outside", (1,), np.int32)
    shape = tuple(values.shape)
    values = values.reshape((-1, shape[-1]))
    rt.hough.points.first_outside(
        found.points, found.starts, values, float(low), float(high), index
    )
    first = int(rt.to_numpy(index)[0])
    if first < int(rt.to_numpy(found.starts)[-1]):
        row, column = (int(i) for i in rt.to_numpy(found.points)[first])
        value = float(rt.to_numpy(values)[row, column])
        place = (row, column) if len(shape) == 2 else (*divmod(row, shape[1]), column)
        rule = f">= {low:g}" if high == math.inf else f"in [{low:g}, {high:g}]"
        raise ValueError(f"{name} must be {rule} where the mask is set, got {value:g} at {place}")
