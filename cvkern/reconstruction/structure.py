"""Structure from motion: from photographs to their cameras, and points of the scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._checks import as_items, as_numbers, check_choice, check_flag, check_integer
from cvkern._files import as_path
from cvkern._runtime import refuse_capture, runtime
from cvkern.geometry.cameras.lens import Camera, check_lens, matrix_of
from cvkern.images._formats import PHOTOGRAPHS
from cvkern.panorama.registration import Heap, Progress, check_heap, make_small
from cvkern.reconstruction._adjustment import lens_row
from cvkern.reconstruction._growth import Growth
from cvkern.reconstruction._pairs import consistent, match, verify, with_focals
from cvkern.reconstruction._photographs import MOST_KEYPOINTS, Lenses, find_keypoints
from cvkern.reconstruction._tracks import find_tracks
from cvkern.reconstruction.models import Reconstruction, levelled

GUESS = 1.2  # focal length of an unknown lens, in longest sides, where nothing tells it
TRIAL = 8  # photographs by which focal lengths are compared
WORST = 4.0  # pixels


def reconstruct(
    images: Any,
    cameras: Camera | Sequence[Camera] | None = None,
    *,
    names: Sequence[str] | None = None,
    focal_lengths: Any = None,
    lens: str = "shared",
    refine: bool = False,
    max_keypoints: int = MOST_KEYPOINTS,
    data_range: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Reconstruction:
    """Find the cameras of photographs of a rigid scene, and points of the scene.

    Photographs that could not be placed are named; if the photographs show several scenes, the
    result has the one that most of them show. A camera that only turns gives no result.

    Parameters
    ----------
    images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4), or path of a folder
        At least two photographs. Those of more than 0.6 megapixels are reduced to that size to find
        keypoints, whose places are between the pixels. Opacity 0 hides keypoints. From a folder,
        all photographs are read in the order of their names, as they are stored (an EXIF
        orientation is ignored); their EXIF focal lengths are used where they have one.
    cameras : Camera or sequence of Camera, optional
        The known camera of all photographs, or of each. By default the focal length and the lens's
        k1 and k2 are found from three and five photographs on, and the principal point, near the
        middle, from eight on.
    names : sequence of str, optional
        Names of the photographs, for files; by default those of the files, or numbers.
    focal_lengths : float or sequence of float, optional
        Approximate focal lengths in pixels, of all or of each photograph; NaN where unknown.
    lens : {'shared', 'own'}, default 'shared'
        Whether photographs of one size (and one given focal length) have one lens, or each its own.
    refine : bool, default False
        Whether given `cameras` are improved.
    max_keypoints : int, default 4000
        Largest number of keypoints of a photograph.
    data_range : float, optional
        The value of white. By default the largest number of an integer dtype, else 1.
    seed : int, default 0
        Seed of the samples. Equal photographs, options and seed give equal results.
    progress : function, optional
        Called with the number of completed steps, the number of all steps, and the name of the next
        one.

    Returns
    -------
    Reconstruction
        Poses of all photographs, lenses, points with colours, errors, and which photograph shows
        which point.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    TypeError
        If an image does not hold real numbers, or an option is of the wrong type.
    ValueError
        If there are fewer than two images, one is empty or of another shape, cameras, names or
        focal lengths are not as many as the images or do not match them, or an option is out of
        range.

    See Also
    --------
    write_reconstruction : Write the result for COLMAP or for radiance fields.
    adjust_bundle : The least squares behind it.

    Notes
    -----
    SIFT keypoints of all pairs of photographs are matched; beyond 20 photographs, the 500 strongest
    keypoints of all pairs are compared first, and each photograph is matched with the 16 that have
    most such matches. Essential matrices verify the pairs, and triplets whose turns do not close
    are left out. Matches are joined to tracks; a track never has two places in one photograph.

    References
    ----------
    .. [1] J. Schönberger and J.-M. Frahm, "Structure-from-motion revisited", CVPR 2016.
    .. [2] B. Triggs, P. McLauchlan, R. Hartley and A. Fitzgibbon, "Bundle adjustment: a modern
       synthesis", Vision Algorithms, LNCS 1883, 2000.
    .. [3] C. Zach, M. Klopschitz and M. Pollefeys, "Disambiguating visual relations using loop
       constraints", CVPR 2010.

    Examples
    --------
    >>> import cvkern
    >>> from cvkern.radiance import make_scene
    >>> scene = make_scene(layout="forward", train=6, test=0, size=160, texture=True)
    >>> len(cvkern.reconstruct(scene.images, focal_lengths=240).placed)
    6
    """
    refuse_capture("reconstruct")
    check_choice(lens, ("shared", "own"), "lens")
    refine = check_flag(refine, "refine")
    most = check_integer(max_keypoints, "max_keypoints", 1, 2**18)
    seed = check_integer(seed, "seed", 0, 2**31 - 1)
    if isinstance(images, (str, Path)):
        images, found_names, told = _from_folder(as_path(images, "images"))
        names = found_names if names is None else names
        focal_lengths = told if focal_lengths is None and cameras is None else focal_lengths
    images = check_heap(images, data_range)
    if len(images) < 2:
        raise ValueError(f"images must be at least two, got {len(images)}")
    count = len(images)
    labels = _check_names(names, count)
    shapes = [tuple(image.shape[:2]) for image in images]
    given = _check_cameras(cameras, shapes)
    focals = _check_focals(focal_lengths, count)
    if given is not None and np.isfinite(focals).any():
        raise ValueError("focal_lengths must not be given with cameras, got both")
    heap = make_small(images, data_range)
    lenses = _lenses(heap, given, focals, lens == "own", refine)
    say = progress or (lambda done, total, text: None)
    rt = runtime(*images)
    found = find_keypoints(rt, heap, say, most)
    matched = match(rt, found, say)
    best, score = None, -math.inf
    choices = with_focals(found, matched, lenses, seed)
    for chosen in choices:
        say(1, 3, "Verifying pairs")
        pairs = consistent(verify(found, matched, chosen, seed), count)
        growth = Growth(find_tracks(found, pairs), pairs, chosen, seed)
        if not growth.begin():
            continue
        if len(choices) > 1:
            growth.grow(say, TRIAL)
        number, error = growth.cost()
        good = number * max(0.0, 1 - error / WORST)
        if good > score:
            best, score = growth, good
    if best is None:
        return _nothing(labels, lenses, heap)
    best.grow(say)
    best.settle()
    return _finished(labels, best, heap)


def _from_folder(folder: Path) -> tuple[list[np.ndarray], list[str], list[float]]:
    """Read the photographs of a folder, their names and their EXIF focal lengths."""
    from cvkern.images._exif import focal_length
    from cvkern.images.files import read_image

    if not folder.is_dir():
        raise FileNotFoundError(f"images must be a folder that exists, got {str(folder)!r}")
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS and p.is_file())
    images = [read_image(file, orient=False) for file in files]
    told = [focal_length(f, i.shape) for f, i in zip(files, images, strict=True)]
    return images, [f.name for f in files], [math.nan if t is None else t for t in told]


def _check_names(names: Any, count: int) -> tuple[str, ...]:
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


def _check_cameras(cameras: Any, shapes: list[tuple[int, int]]) -> Sequence[Camera] | None:
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
    return found


def _check_focals(focal_lengths: Any, count: int) -> np.ndarray:
    if focal_lengths is None:
        return np.full(count, np.nan)
    found = as_numbers(focal_lengths, "focal_lengths")
    found = np.full(count, float(found)) if found.ndim == 0 else found
    if found.shape != (count,):
        raise ValueError(f"focal_lengths must be one, or {count}, got shape {found.shape}")
    wrong = found[~(np.isnan(found) | (np.isfinite(found) & (found > 0)))]
    if len(wrong):
        raise ValueError(f"focal_lengths must be > 0 and finite, or NaN, got {wrong[0]:g}")
    return found


def _lenses(
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
            rows.append(_scaled(row, heap.factors[i]))
            told.append(known)
        of.append(kinds[key])
    return Lenses(np.stack(rows), np.array(of), np.array(told), given is not None and not refine)


def _scaled(row: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Return a lens of an image shrunk by factors of x and y."""
    found = row.copy()
    found[:2] *= factors
    found[2:4] = (row[2:4] + 0.5) * factors - 0.5
    return found


def _cameras(rows: np.ndarray, of: np.ndarray, heap: Heap) -> tuple[Camera, ...]:
    """Return the lenses in pixels of the photographs."""
    found = []
    for n, row in enumerate(rows):
        image = int(np.flatnonzero(of == n)[0])
        lens = _scaled(row, 1 / heap.factors[image])
        found.append(Camera(matrix_of(*lens[:4]), lens[4:], tuple(heap.images[image].shape[:2])))
    return tuple(found)


def _nothing(names: tuple[str, ...], lenses: Lenses, heap: Heap) -> Reconstruction:
    """Return a reconstruction without a placed photograph."""
    return Reconstruction(
        names, np.full((len(names), 3, 4), np.nan), _cameras(lenses.rows, lenses.of, heap),
        lenses.of, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros((0, 2), np.int32),
        np.zeros((0, 2)), np.zeros(0),
    )  # fmt: skip


def _finished(names: tuple[str, ...], growth: Growth, heap: Heap) -> Reconstruction:
    """Return what has grown, in pixels of the photographs and a level world."""
    tracks, placed = growth.tracks, growth.placed
    chosen = np.flatnonzero(growth.active)
    kept, point, counts = np.unique(tracks.track[chosen], return_inverse=True, return_counts=True)
    point, view = point.reshape(-1), tracks.view[chosen]
    turns = growth.rotations.transpose(0, 2, 1)
    eyes = -np.einsum("nij,nj->ni", turns, growth.translations)
    poses = np.full((len(names), 3, 4), np.nan)
    whole = np.concatenate((turns, eyes[:, :, None]), axis=2)
    poses[placed], points = levelled(whole[placed], growth.points[kept])
    large = (tracks.where[chosen] + 0.5) / heap.factors[view] - 0.5
    off = growth.distances(chosen) / np.sqrt(heap.factors[view].prod(axis=1))
    first = np.unique(point, return_index=True)[1]
    return Reconstruction(
        names, poses, _cameras(growth.rows, growth.lenses.of, heap), growth.lenses.of, points,
        tracks.color[chosen][first], np.stack((point, view), axis=1).astype(np.int32),
        np.ascontiguousarray(large[:, ::-1]), np.bincount(point, off, len(kept)) / counts,
    )  # fmt: skip
