"""Make the picture of the README, docs/edges.jpg: ``python docs/picture.py``.

The photograph is scikit-image's ``coffee``, which its photographer (Rachel Michetti) gave away
under CC0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import cvkern
from cvkern.images import apply_colormap, luma, write_image

GAP = 8  # pixels between the panels


def main() -> None:
    """Put the photograph, its edges and the direction of its gradient side by side."""
    from skimage import data

    photo = data.coffee()
    gray = luma(photo)
    edges = cvkern.canny(gray, 2, low_threshold=0.7, high_threshold=0.9, use_quantiles=True)
    gradient = cvkern.gradient(gray, sigma=2)
    hue = apply_colormap(gradient.orientation, "cyclic")
    bright = (gradient.magnitude / np.quantile(gradient.magnitude, 0.985)).clip(0, 1) ** 0.7
    panels = (
        photo,
        np.repeat(np.where(edges, np.uint8(20), np.uint8(255))[..., None], 3, axis=2),
        np.round(hue * bright[..., None]).astype(np.uint8),
    )
    gap = np.full((photo.shape[0], GAP, 3), 255, np.uint8)
    row = np.hstack([part for panel in panels for part in (panel, gap)][:-1])
    write_image(Path(__file__).with_name("edges.jpg"), row)


if __name__ == "__main__":
    main()
