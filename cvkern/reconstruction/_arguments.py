"""Arguments of a reconstruction: photographs of a folder, names, lenses, and their checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_array, as_items, as_numbers, check_choice
from cvkern._notices import warn
from cvkern._runtime import Runtime
from cvkern.features._photographs import as_host
from cvkern.geometry._matrices import check_camera
from cvkern.geometry.cameras.lens import Camera, check_lens
from cvkern.images._formats import PHOTOGRAPHS
from cvkern.panorama.registration import Heap, Progress, check_heap, make_small
from cvkern.reconstruction._adjustment import lens_row
from cvkern.reconstruction._course import Options
from cvkern.reconstruction._photographs import Lenses

# Pixels. No picture has a focal length beyond these. Between them no quotient overflows, and all
# camera matrices have inverses.
LEAST_FOCAL, MOST_FOCAL = 1e-3, 1e9
PAIRS = "auto", "all", "vocabulary", "sequence"
GUESS = 1.2  # focal length of an unknown lens, in longest sides, where nothing tells it


class Photographs(NamedTuple):
    """The photographs of a folder, without their pixels, and their small copies."""

    heap: Heap
    names: list[str]
    focals: list[float]
    """EXIF focal lengths, pixels; NaN where unknown."""


def read_folder(folder: Path, data_range: float | None, say: Progress) -> Photographs:
    """Read the photographs of a folder one by one; warn of those that cannot be read."""
    from cvkern.images._exif import focal_length
    from cvkern.images.files import read_image

    if not folder.is_dir():
        raise FileNotFoundError(f"images must be a folder that exists, got {str(folder)!r}")
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS and p.is_file())
    images, small, factors, whites, names, focals = [], [], [], [], [], []
    for n, file in enumerate(files):
        say(n, len(files), "Reading")
        try:
            image = read_image(file, orient=False)
        except ValueError as error:
            warn(f"a photograph is left out: {error}")
            continue
        one = make_small(check_heap([image], data_range), data_range)
        # Only shape and dtype are needed of the large one, not its memory.
        images.append(np.broadcast_to(np.zeros((), image.dtype), image.shape))
        small += one.small
        factors.append(one.factors)
        whites += one.whites
        names.append(file.name)
        told = focal_length(file, image.shape)
        focals.append(math.nan if told is None else told)
    if not images:
        raise ValueError(f"images must not be empty, got no photograph in {str(folder)!r}")
    return Photographs(Heap(images, small, np.concatenate(factors), whites), names, focals)


def check_names(names: Any, count: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f"{i:04d}" for i in range(count))
    names = as_items(names, "names", "strings")
    if not all(isinstance(name, str) for name in names):
        raise TypeError(f"names must be strings, got {names!r}")
    if len(names) != count or len(set(names)) != count:
        raise ValueError(
            f"names must be {count} different ones, got {len(names)}, {len(set(names))} different"
        )
    wrong = [name for name in names if not name or any(c in name for c in "\n\r\0")]
    if wrong:
        raise ValueError(f"names must be lines of text, got {wrong[0]!r}")
    return tuple(names)


def check_cameras(cameras: Any, shapes: list[tuple[int, int]]) -> Sequence[Camera] | None:
    if cameras is None:
        return None
    found = (
        [cameras] * len(shapes)
        if isinstance(cameras, Camera)
        else as_items(cameras, "cameras", "one Camera or several")
    )
    if len(found) != len(shapes):
        raise ValueError(f"cameras must be one, or {len(shapes)}, got {len(found)}")
    for i, (camera, shape) in enumerate(zip(found, shapes, strict=True)):
        if check_lens(camera, f"cameras[{i}]").shape != shape:
            raise ValueError(
                f"cameras[{i}] must be for an image of shape {shape}, got {camera.shape}"
            )
        check_camera(camera.matrix, f"cameras[{i}].matrix")
    return found


def check_focals(focal_lengths: Any, count: int) -> np.ndarray:
    if focal_lengths is None:
        return np.full(count, np.nan)
    found = as_numbers(focal_lengths, "focal_lengths")
    found = np.full(count, float(found)) if found.ndim == 0 else found
    if found.shape != (count,):
        raise ValueError(f"focal_lengths must be one, or {count}, got shape {found.shape}")
    wrong = found[~(np.isnan(found) | ((found >= LEAST_FOCAL) & (found <= MOST_FOCAL)))]
    if len(wrong):
        rule = f"in [{LEAST_FOCAL:g}, {MOST_FOCAL:g}] pixels, or NaN"
        raise ValueError(f"focal_lengths must be {rule}, got {wrong[0]:g}")
    return found


def check_pairs(pairs: Any, count: int) -> str | np.ndarray:
    """Return the name of a way to choose pairs, or different pairs (P, 2), i < j."""
    if isinstance(pairs, str):
        check_choice(pairs, PAIRS, "pairs")
        return pairs
    found = np.asarray(as_array(pairs, "pairs")) if np.size(pairs) else np.zeros((0, 2), int)
    if found.dtype.kind not in "iu":
        raise TypeError(f"pairs must be integers, or one of {PAIRS}, got {found.dtype}")
    if found.ndim != 2 or found.shape[1] != 2:
        raise ValueError(f"pairs must have shape (P, 2), got {found.shape}")
    found = np.sort(found.astype(np.int64), axis=1)
    if found.size and (
        found.min() < 0 or found.max() >= count or (found[:, 0] == found[:, 1]).any()
    ):
        raise ValueError(f"pairs must be two different images of {count}, got others")
    return np.unique(found, axis=0)


def plan_of(rt: Runtime, heap: Heap, lenses: list[Any], options: Options) -> dict[str, Any]:
    """Return the heading of a journal: the photographs, the options, the version of the library."""
    from cvkern import __version__

    given, *others = lenses
    rows = [] if given is None else [lens_row(camera).tolist() for camera in given]
    return {
        "function": "reconstruct",
        "version": __version__,
        "shapes": [[*image.shape] for image in heap.images],
        "images": [as_host(rt, image) for image in heap.small],
        "lenses": [rows, *others],
        "options": options,
    }


def lenses_of(
    heap: Heap, given: Sequence[Camera] | None, focals: np.ndarray, own: bool, refine: bool
) -> Lenses:
    """Return the lenses as far as they are known, in pixels of the small photographs."""
    kinds: dict[Any, int] = {}
    rows, of, told = [], [], []
    for i, image in enumerate(heap.images):
        height, width = image.shape[:2]
        if given is not None:
            row = lens_row(given[i])
            known = True
        else:
            known = bool(np.isfinite(focals[i]))
            focal = focals[i] if known else GUESS * max(height, width)
            row = np.array([focal, focal, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0, 0])
        key = i if own else (height, width, *(row.tolist() if known else ()))
        if key not in kinds:
            kinds[key] = len(kinds)
            rows.append(scaled(row, heap.factors[i]))
            told.append(known)
        of.append(kinds[key])
    return Lenses(np.stack(rows), np.array(of), np.array(told), given is not None and not refine)


def scaled(row: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Return a lens of an image shrunk by factors of x and y."""
    found = row.copy()
    found[:2] *= factors
    found[2:4] = (row[2:4] + 0.5) * factors - 0.5
    return found
