"""Arguments of shape models: pictures, boxes, masks and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import (
    as_items,
    as_numbers,
    check_image,
    check_integer,
    check_positive,
)
from cvkern._runtime import runtime
from cvkern._whites import white_of
from cvkern.features._photographs import as_host, prepared
from cvkern.transform.resampling import resize

SCALES = (0.71, 0.84, 1.0, 1.19, 1.41)  # sizes of objects, a quarter of an octave apart
MOST_SCALES = 64
Box = tuple[int, int, int, int]
LEAST_SCALE, MOST_SCALE = 1 / 16, 16.0


def pictures_of(values: Any, name: str) -> tuple[Any, ...]:
    return as_items(values, name, "a sequence of pictures")


def check_picture(image: Any, name: str, data_range: float | None) -> tuple[Any, float]:
    """Return a picture and its value of white."""
    image = check_image(image, ndim=(2, 3), name=name)
    if len(image.shape) == 3 and image.shape[2] not in (3, 4):
        raise ValueError(f"{name} must have 3 or 4 channels, got shape {tuple(image.shape)}")
    return image, white_of(image, data_range)


def grays_of(images: Any, name: str, data_range: float | None) -> list[np.ndarray]:
    """Return the greys of pictures on the host, in parts of white."""
    found = []
    for number, image in enumerate(pictures_of(images, name)):
        image, white = check_picture(image, f"{name}[{number}]", data_range)
        rt = runtime(image)
        found.append(np.array(rt.to_numpy(prepared(rt, image, white))))
    return found


def check_boxes(boxes: Sequence[Any] | None, pictures: list[np.ndarray]) -> list[list[Box]]:
    """Return the boxes of each picture, in whole pixels."""
    if boxes is None:
        return [[(0, 0, *picture.shape)] for picture in pictures]
    given = as_items(boxes, "boxes", "a sequence of arrays (N, 4)")
    if len(given) != len(pictures):
        raise ValueError(f"boxes must be of {len(pictures)} pictures, got {len(given)}")
    found = []
    for n, (values, picture) in enumerate(zip(given, pictures, strict=True)):
        if np.size(values) % 4:
            raise ValueError(f"boxes[{n}] must have shape (N, 4), got {np.shape(values)}")
        array = as_numbers(values, f"boxes[{n}]").reshape(-1, 4)
        if not np.isfinite(array).all():
            raise ValueError(f"boxes[{n}] must be finite, got others")
        whole = np.rint(array).astype(np.int64)
        if (
            (whole[:, :2] < 0).any()
            or (whole[:, 2:] > picture.shape).any()
            or (whole[:, 2:] <= whole[:, :2]).any()
        ):
            raise ValueError(
                f"boxes[{n}] must be within the picture of shape {picture.shape}, got others"
            )
        found.append([tuple(box) for box in whole.tolist()])
    if not any(found):
        raise ValueError("boxes must have at least one object, got none")
    return found


def check_masks(masks: Sequence[Any], pictures: list[np.ndarray]) -> list[np.ndarray]:
    """Return masks of the pictures as 0 and 1."""
    given = pictures_of(masks, "masks")
    if len(given) != len(pictures):
        raise ValueError(f"masks must be of {len(pictures)} pictures, got {len(given)}")
    found = []
    for n, (mask, picture) in enumerate(zip(given, pictures, strict=True)):
        mask = check_image(mask, name=f"masks[{n}]")
        if tuple(mask.shape) != picture.shape:
            raise ValueError(f"masks[{n}] must have shape {picture.shape}, got {tuple(mask.shape)}")
        found.append((as_host(runtime(mask), mask) != 0).astype(np.float32))
    return found


def check_scales(scales: Sequence[float] | None, usual: float) -> tuple[float, ...]:
    """Return sizes of objects, ascending; by default `SCALES` times the usual one."""
    if scales is None:
        scales = [min(max(usual * s, LEAST_SCALE), MOST_SCALE) for s in SCALES]
    given = as_items(scales, "scales", "a sequence of numbers")
    check_integer(len(given), "the number of scales", 1, MOST_SCALES)
    sizes = sorted({check_positive(scale, "scales") for scale in given})
    if not LEAST_SCALE <= sizes[0] <= sizes[-1] <= MOST_SCALE:
        raise ValueError(f"scales must be in [{LEAST_SCALE:g}, {MOST_SCALE:g}], got {sizes}")
    return tuple(sizes)


def cut_all(
    pictures: list[np.ndarray], boxes: list[list[Box]], shape: tuple[int, int]
) -> np.ndarray:
    """Return the contents of the boxes of pictures, each at the size of the model."""
    found = []
    for picture, inside in zip(pictures, boxes, strict=True):
        for top, left, bottom, right in inside:
            part = np.ascontiguousarray(picture[top:bottom, left:right])
            found.append(part if part.shape == shape else np.asarray(resize(part, shape)))
    return np.stack(found)
