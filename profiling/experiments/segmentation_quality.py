"""Pixels of rendered mugs in photographs, as a shape model cuts them out.

python -m profiling.experiments.segmentation_quality \
    profiling/results/experiments/segmentation_quality.json
"""

import json
import sys
from pathlib import Path

import numpy as np
import scipy.ndimage as ndi
from skimage import data

import cvkern
from cvkern._files import replacing, write_text

SHAPE = 200, 260
SCALES = 0.8, 1.0, 1.25
TRAINED, TESTED = 24, 40
TURN = 0.06  # radians, standard deviation


def mug(scale: float, turn: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a shaded mug with a pattern, and its pixels."""
    height, width = int(64 * scale), int(80 * scale)
    y, x = (
        (i - (n - 1) / 2) / scale
        for i, n in zip(np.indices((height, width)), (height, width), strict=True)
    )
    along = np.cos(turn) * x - np.sin(turn) * y
    down = np.sin(turn) * x + np.cos(turn) * y
    ring = np.hypot(along - 12, down)
    body = (abs(along + 8) < 20) & (abs(down) < 24)
    handle = (ring > 10) & (ring < 18) & (along > 8)
    noise = ndi.gaussian_filter(np.random.default_rng(1).normal(size=(64, 96)), 2)
    pattern = (noise - noise.min()) / np.ptp(noise)
    print_ = ndi.map_coordinates(pattern, [down + 32, along + 48], order=1, mode="nearest")
    shade = (0.55 + 0.35 * np.cos((along + 8) / 15.7)) * (0.5 + 0.6 * print_)
    value = np.where(body, shade, 0.35 + 0.3 * np.cos(ring / 3))
    value[body & (down < -18)] = 0.9  # the rim
    return np.clip(value + rng.normal(0, 0.03, value.shape), 0, 1), body | handle


def scene(number: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a part of a photograph with a mug in it, and the mug's pixels."""
    rng = np.random.default_rng(number)
    photos = data.camera(), data.brick(), data.grass(), data.gravel(), data.page()
    photo = photos[number % len(photos)] / 255
    photo = np.pad(
        photo, [(0, max(0, m - n)) for n, m in zip(photo.shape, SHAPE, strict=True)], mode="reflect"
    )
    row, column = (rng.integers(0, n - m + 1) for n, m in zip(photo.shape, SHAPE, strict=True))
    image = photo[row : row + SHAPE[0], column : column + SHAPE[1]].astype(np.float32)
    values, shown = mug(scale, rng.normal(0, TURN), rng)
    row, column = (rng.integers(0, n - m + 1) for n, m in zip(SHAPE, values.shape, strict=True))
    part = np.s_[row : row + len(values), column : column + values.shape[1]]
    image[part][shown] = values[shown]
    mask = np.zeros(SHAPE, bool)
    mask[part] = shown
    return image, mask


def overlaps() -> list[float]:
    """Return intersection over union of the strongest object with the mug in each scene."""
    known = [scene(100 + i, 1.0) for i in range(TRAINED)]
    boxes = []
    for _, mask in known:
        (top, bottom), (left, right) = (np.nonzero(mask.any(axis=i))[0][[0, -1]] for i in (1, 0))
        box = top - 2, left - 2, bottom + 3, right + 3
        boxes.append([np.clip(box, 0, (*SHAPE, *SHAPE))])
    photos = data.camera(), data.brick(), data.grass(), data.gravel(), data.page()
    others = [p[part] for p in photos for part in (np.s_[:160, :200], np.s_[-160:, -200:])]
    images, masks = zip(*known, strict=True)
    model = cvkern.ShapeModel(600, patch=12, mirror=False).fit(images, boxes, masks, others)
    found = []
    for i in range(TESTED):
        image, mask = scene(500 + i, SCALES[i % len(SCALES)])
        masks = model.segment(image).masks
        shown = masks[0] if len(masks) else np.zeros(SHAPE, bool)
        found.append(float((shown & mask).sum() / (shown | mask).sum()))
    return found


def main(file: Path) -> None:
    """Write the overlaps, and their mean and least, to `file`."""
    found = overlaps()
    result = {"scales": SCALES, "overlaps": found, "mean": np.mean(found), "least": min(found)}
    with replacing(file) as beside:
        write_text(beside, json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
