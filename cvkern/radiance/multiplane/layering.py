"""From a depth for each pixel to the texels of planes."""

from __future__ import annotations

from typing import Any

import numpy as np


def opacities(places: np.ndarray, planes: int) -> np.ndarray:
    """Return the opacities (D, H, W) of planes that show surfaces between them.

    `places` (H, W) are numbers of planes from 0 to D - 1, with fractions. A pixel at k + f has the
    opacity 1 - f in plane k and 1 in plane k + 1, which together let no light through: seen from
    the reference camera, they have the weights 1 - f and f.
    """
    near = np.floor(places).astype(np.int64).clip(0, max(planes - 2, 0))
    share = (places - near).clip(0, 1)
    found = np.zeros((planes, *places.shape), np.float32)
    np.put_along_axis(found, near[None], (1 - share)[None].astype(np.float32), 0)
    if planes > 1:
        np.put_along_axis(found, near[None] + 1, (share > 0)[None].astype(np.float32), 0)
    return found


def extend(opacity: np.ndarray, places: np.ndarray, reach: int) -> list[tuple]:
    """Extend planes behind nearer surfaces, in place, and return the copies that were made.

    A texel of a plane that a nearer surface hides takes the opacity of the nearest texel of its
    plane that shows something, if this is at most `reach` texels away. `opacity` is (D, H, W). The
    result has, for each plane, the indices of such texels and those of the texels that they are
    like, which also have the likely colour.
    """
    from scipy.ndimage import distance_transform_edt

    empty = (np.zeros(0, np.int64),) * 2
    copied = [(empty, empty)] * len(opacity)
    for k in range(2, len(opacity)) if reach else ():
        shown, hidden = opacity[k] > 0, places < k - 1
        if not shown.any() or not hidden.any():
            continue
        # Nothing farther away than this is filled.
        part = tuple(
            slice(max(0, n[0] - reach), n[-1] + reach + 1)
            for n in (np.flatnonzero(shown.any(axis=a)) for a in (1, 0))
        )
        nearest: Any = distance_transform_edt(~shown[part], return_indices=True)
        away, (i, j) = nearest
        fill = np.nonzero(hidden[part] & (away <= reach))
        first = part[0].start, part[1].start
        to = fill[0] + first[0], fill[1] + first[1]
        like = i[fill] + first[0], j[fill] + first[1]
        opacity[k][to] = opacity[k][like]
        copied[k] = to, like
    return copied
