"""Masks of photographs: pictures in which the pixels that count are bright, and the others dark."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

SEEN = 128  # least value of a pixel that counts


def beside(folder: Path, names: Sequence[str]) -> list[Path | None]:
    """Return the masks of photographs `names` of `folder`, None for those that have none.

    They are in ``masks`` beside ``images``, or ``masks_2`` beside ``images_2``, named as the
    photographs: ``a.jpg.png``, as in COLMAP, or ``a.png``.
    """
    masks = folder.parent / folder.name.replace("images", "masks")
    if masks == folder or not masks.is_dir():
        return [None] * len(names)
    tried = ((masks / f"{n}.png", (masks / n).with_suffix(".png")) for n in names)
    return [next((file for file in files if file.is_file()), None) for files in tried]


def read_masks(files: Sequence[Path | None], height: int, width: int) -> np.ndarray | None:
    """Read masks (N, H, W) bool of photographs; None if no photograph has one."""
    from cvkern.images.files import read_image

    if not any(files):
        return None
    found = np.ones((len(files), height, width), bool)
    for mask, file in zip(found, files, strict=True):
        if file is not None:
            image = read_image(file, orient=False)
            if image.shape[:2] != mask.shape:
                raise ValueError(
                    f"{file} must have the size of its photograph, {mask.shape}, got "
                    f"{image.shape[:2]}"
                )
            if image.dtype != np.uint8:
                raise ValueError(f"{file} must have 8 bits a channel, got {image.dtype}")
            mask[:] = (image if image.ndim == 2 else image[..., :3].max(axis=2)) >= SEEN
    return found
