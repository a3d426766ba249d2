"""Panoramas of heaps of photographs that do not fit into memory."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import cvkern
from cvkern._checks import check_choice, check_flag, check_integer, check_positive
from cvkern._files import as_path
from cvkern._runtime import Runtime, refuse_capture, runtime, use
from cvkern.images._exif import focal_length
from cvkern.panorama.blending import Place, blend_tile, places_of
from cvkern.panorama.drawing import Drawing, Panorama, panorama_of, prepare
from cvkern.panorama.planning import Options, Plan, check_focals, check_options, plan_panoramas
from cvkern.panorama.recognition import silent
from cvkern.panorama.registration import Heap, Progress
from cvkern.panorama.surfaces import Canvas
from cvkern.scale.engines import engine_of, place_of
from cvkern.scale.groups import read_heap
from cvkern.scale.heaps import files_of
from cvkern.scale.journals import Journal
from cvkern.scale.targets import SUFFIXES, target_of

MAX_PIXELS = 10**10
MAX_BYTES = 2**29
DEFAULTS: dict[str, Any] = {
    name: option.default
    for name, option in signature(cvkern.stitch).parameters.items()
    if name not in ("images", "crop", "names", "progress")
} | {"max_pixels": MAX_PIXELS}
WRITTEN = re.compile(r"panorama-\d+(-mask)?\.(npy|tif|zarr)")


class Heaped(NamedTuple):
    """The panoramas of a heap of files."""

    panoramas: list[Panorama]
    """As :func:`cvkern.stitch` returns them; `members` and `pairs` are indices of `files`, `image`
    and `mask` are the arrays in the files that were written."""
    files: list[str]
    """The files of the heap."""
    failed: dict[str, str]
    """The files that could not be read, with the reason of each."""


def stitch(
    paths: Any,
    target: Any,
    *,
    suffix: str = ".npy",
    tile: int | None = None,
    max_bytes: int = MAX_BYTES,
    engine: Any = "threads",
    workers: int = 2,
    device: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> Heaped:
    """Make every panorama of a heap of files that need not fit into memory, nor its panoramas.

    Each photograph is read once to find its keypoints. These and a copy of at most 0.6 megapixels
    are kept on disk, in `target`. Pairs, cameras, seams and gains come from them, as in
    :func:`cvkern.stitch`. Then each panorama is drawn tile by tile, from the photographs that lie
    in a tile, and written into a file of its own. A file that cannot be read is left out.

    If a run is killed, the same call goes on where it was: with the photographs whose keypoints are
    missing, or the tiles that are not written. If a panorama was refused as too large, a call with
    another `scale` finds the keypoints and pairs again.

    Parameters
    ----------
    paths : path of a folder, or sequence of paths
        Image files. Those of another dtype than most become images of that one; white stays white.
    target : path
        The folder of the results, which is made if need be: ``panorama-1.npy`` and so on, with
        ``panorama-1-mask.npy`` beside it.
    suffix : {'.npy', '.tif', '.zarr'}, default '.npy'
        The form of the results.
    tile : int, optional
        Side of a tile, pixels, rounded down to a multiple of the pixels of the coarsest band. By
        default that of :func:`cvkern.stitch`: 2048 on the CPU, 4096 on a GPU.
    max_bytes : int, default 2**29
        Photographs that were read are kept for the next tile while they have at most so many bytes
        together, or one of them has.
    engine, workers, device
        As in :func:`map_images`, for the keypoints. Tiles are drawn on one device.
    overwrite : bool, default False
        Replace panoramas that `target` has.
    progress : function, optional
        As in :func:`cvkern.stitch`.
    **options
        As :func:`cvkern.stitch` takes them, except for `crop`. `focal_lengths` may be 'exif', for
        those that the files tell; by default `max_pixels` is 10^10.

    Returns
    -------
    Heaped
        `panoramas`, `files` and `failed`.

    Raises
    ------
    TypeError
        If a path is not one, or an option does not exist.
    ValueError
        If no file can be read, `target` has panoramas and `overwrite` is false, `target` has the
        journal of another call, a file changes meanwhile, an option is out of its range, or as
        :func:`cvkern.stitch` and :func:`map_images`.
    ImportError
        If the engine, or Zarr for '.zarr', is not installed.
    FileNotFoundError
        If `paths` names no folder that exists.
    OSError
        If `target` cannot be written.

    Warns
    -----
    UserWarning
        As :func:`cvkern.stitch`.

    Notes
    -----
    With the default `tile`, every bit is that of ``cvkern.stitch`` on the same images. With another
    one, a coarse band ends elsewhere, which changes colours by less than a grey value.

    Memory holds a tile with its border, `max_bytes` of photographs, 64 KB of keypoints a photograph
    while pairs are looked for, the matches of the pairs, and the normal equations of the cameras,
    (4 N)^2 numbers for N photographs of one panorama.

    Examples
    --------
    >>> import tempfile
    >>> from skimage import data
    >>> from cvkern import scale
    >>> from cvkern.images import write_image
    >>> folder, wide = tempfile.mkdtemp(), data.coffee()
    >>> write_image(f"{folder}/a.png", wide[:, :350])
    >>> write_image(f"{folder}/b.png", wide[:, 250:])
    >>> found = scale.stitch(folder, f"{folder}/out")
    >>> found.panoramas[0].members, found.panoramas[0].image.shape
    ([0, 1], (400, 600, 3))
    """
    refuse_capture("scale.stitch")
    files = files_of(paths)
    if suffix not in SUFFIXES:
        raise ValueError(f"suffix must be one of {', '.join(SUFFIXES)}, got {suffix!r}")
    side = None if tile is None else check_integer(tile, "tile", 1, 2**14)
    most = check_integer(max_bytes, "max_bytes", 0, 2**62)
    checked, focals, white = _checked(options, len(files))
    folder, say = as_path(target, "target"), progress or silent
    backend, place = place_of(device)
    started = engine_of(engine, check_integer(workers, "workers", 1, 4096), place)
    journal, old = folder / "journal", _written(folder)
    if old and not journal.exists() and not check_flag(overwrite, "overwrite"):
        raise ValueError(
            f"target must have no panoramas yet, got {str(min(old))!r}: overwrite replaces them"
        )
    read = {file.resolve() for file in files}
    over = next((path for path in old if path.resolve() in read), None)
    if over is not None:
        raise ValueError(
            f"target must not hold a file of paths, got {str(over)!r}: take another folder"
        )
    folder.mkdir(parents=True, exist_ok=True)
    call = {"files": [_state(f) for f in files], "data_range": white, "backend": backend}
    book = Journal(journal, {"function": "stitch"} | call)
    # Options of the drawing are noted apart: a call that changes only these keeps the keypoints.
    how = {"options": options, "suffix": suffix, "tile": tile}
    if (journal / "tiles").exists():
        Journal(journal / "tiles", how)  # refuses another drawing before any work
    notes = journal / "photographs"
    notes.mkdir(exist_ok=True)
    made, written = [], set()
    with use(device=device):
        heap, links, numbers, failed = read_heap(
            files, notes, (started, place), white, book, say, most
        )
        if isinstance(focals, str):
            lengths = [focal_length(image.file, image.shape) for image in heap.images]
            given = np.array([np.nan if f is None else f for f in lengths])
        else:
            given = None if focals is None else focals[numbers]
        plans = plan_panoramas(heap, links, given, checked, [files[n].name for n in numbers])
        tiles = Journal(journal / "tiles", how)
        for number, plan in enumerate(plans):
            text = f"Panorama {number + 1} of {len(plans)}"

            def part(done: float, number: int = number, text: str = text) -> None:
                steps = 2 * len(files), 100 * len(plans)
                say(steps[0] + int(100 * (number + done)), sum(steps), text)

            out = folder / f"panorama-{number + 1}{suffix}"
            written |= {out, _beside(out)}
            one = _drawn(heap, plan, checked, side, out, _Pages(tiles, number), part)
            made.append(_renumbered(one, numbers))
    for stale in old - written:
        shutil.rmtree(stale) if stale.is_dir() else stale.unlink()
    tiles.remove()
    shutil.rmtree(notes)
    book.remove()
    return Heaped(made, [str(f) for f in files], failed)


def _checked(given: dict[str, Any], count: int) -> tuple[Options, Any, float | None]:
    """Return the options of a drawing, the focal lengths of so many files, and white."""
    unknown = sorted(given.keys() - DEFAULTS.keys())
    if unknown:
        raise TypeError(f"options must be among {', '.join(DEFAULTS)}, got {unknown[0]}")
    options = DEFAULTS | given
    focals, white = options.pop("focal_lengths"), options.pop("data_range")
    options["max_pixels"] = check_integer(options["max_pixels"], "max_pixels", 1, 2**48)
    if isinstance(focals, str):
        check_choice(focals, ("exif",), "focal_lengths")
    else:
        focals = check_focals(focals, count)
    white = None if white is None else check_positive(white, "data_range")
    return check_options(**options, crop=False), focals, white


def _state(file: Path) -> list[Any]:
    """Return the path, size and time of a file, which change if another takes its place."""
    try:
        found = file.stat()
    except OSError:
        return [str(file)]
    return [str(file.absolute()), found.st_size, found.st_mtime_ns]


def _written(folder: Path) -> set[Path]:
    """Return the panoramas that a folder has."""
    return {p for p in folder.glob("panorama-*") if WRITTEN.fullmatch(p.name)}


def _beside(out: Path) -> Path:
    return out.with_name(f"{out.stem}-mask{out.suffix}")


class _Pages(NamedTuple):
    """The notes about the tiles of one panorama."""

    book: Journal
    number: int

    def has(self, tile: int) -> bool:
        return self.book.kept(f"{self.number}-{tile}") is not None

    def note(self, tile: int) -> None:
        self.book.note(f"{self.number}-{tile}", {})


def _drawn(
    heap: Heap,
    plan: Plan,
    options: Options,
    side: int | None,
    out: Path,
    pages: _Pages,
    say: Callable[[float], None],
) -> Panorama:
    """Draw a panorama tile by tile into its files."""
    say(0.0)
    rt, canvas = runtime(np.empty(0, np.uint8)), plan.canvas
    drawing = prepare(rt, heap, plan, options)
    places = places_of(rt, canvas, drawing.blend.bands, side)
    waiting = [n for n in range(len(places)) if not pages.has(n)]
    resumed = len(waiting) < len(places)
    shape = canvas.height, canvas.width
    dtype = np.dtype(np.uint16 if drawing.dtype == np.uint16 else drawing.made)
    image = target_of(out, shape + drawing.channels, dtype, resumed)
    mask = target_of(_beside(out), shape, np.dtype(bool), resumed)
    for n in waiting:
        say(0.2 + 0.8 * n / len(places))
        place = places[n]
        part, there = _tile(rt, canvas, drawing, place)
        at = np.s_[place.row : place.row + place.rows, place.column : place.column + place.columns]
        image[at], mask[at] = part.astype(dtype, copy=False), there
        pages.note(n)
    return panorama_of(plan, drawing, image, mask)


def _tile(
    rt: Runtime, canvas: Canvas, drawing: Drawing, place: Place
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels of a tile, and which of them show a photograph."""
    shape = place.rows, place.columns
    part, there = rt.empty(shape + drawing.channels, drawing.made), rt.empty(shape, bool)
    planes = rt.adopt(part, drawing.made, shape=(*shape, drawing.blend.channels))
    given = canvas, drawing.seams, drawing.blend, place
    blend_tile(rt, *given, (0, 0), planes, rt.adopt(there, bool))
    return rt.release(part), rt.release(there)


def _renumbered(panorama: Panorama, numbers: list[int]) -> Panorama:
    """Return a panorama whose members are indices of all files."""
    return panorama._replace(
        members=[numbers[i] for i in panorama.members],
        pairs=[(numbers[i], numbers[j]) for i, j in panorama.pairs],
    )
