"""Which photographs of a heap show the same, without all of them in memory."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_integer, check_positive
from cvkern._runtime import choice, refuse_capture, runtime, use
from cvkern.panorama.recognition import silent
from cvkern.panorama.registration import Heap, Link, Progress, connected, link_features
from cvkern.scale.engines import Task, engine_of, errors_of, place_of
from cvkern.scale.heaps import files_of
from cvkern.scale.journals import Journal
from cvkern.scale.photographs import Keypoints, described, heap_of

PAIRS = 128  # pairs whose keypoints are in memory at a time


class Groups(NamedTuple):
    """Which files of a heap show the same."""

    components: list[list[int]]
    """As :class:`cvkern.Recognition` has them, as indices of `files`, without those that failed."""
    pairs: list[tuple[int, int]]
    """The pairs of files that overlap, i < j, ascending."""
    files: list[str]
    """The files of the heap."""
    failed: dict[str, str]
    """The files that could not be read, with the reason of each."""


def recognize_panoramas(
    paths: Any,
    *,
    engine: Any = "threads",
    workers: int = 2,
    device: str | None = None,
    data_range: float | None = None,
    progress: Progress | None = None,
) -> Groups:
    """Find which files of a heap belong to one panorama, without all of them in memory.

    Parameters
    ----------
    paths, engine, workers, device
        As in :func:`stitch`.
    data_range, progress
        As in :func:`cvkern.recognize_panoramas`.

    Returns
    -------
    Groups
        `components` and `pairs`, of `files`, and those that `failed`.

    Raises
    ------
    TypeError, ValueError, ImportError, FileNotFoundError
        As :func:`stitch`.

    Examples
    --------
    >>> import tempfile
    >>> from skimage import data
    >>> from cvkern import scale
    >>> from cvkern.images import write_image
    >>> folder, wide = tempfile.mkdtemp(), data.coffee()
    >>> for name, image in (("a", wide[:, :350]), ("b", data.camera()), ("c", wide[:, 250:])):
    ...     write_image(f"{folder}/{name}.png", image)
    >>> scale.recognize_panoramas(folder).components
    [[0, 2], [1]]
    """
    refuse_capture("scale.recognize_panoramas")
    files = files_of(paths)
    white = None if data_range is None else check_positive(data_range, "data_range")
    _, place = place_of(device)
    started = engine_of(engine, check_integer(workers, "workers", 1, 4096), place)
    with tempfile.TemporaryDirectory() as folder, use(device=device):
        run, say = (started, place), progress or silent
        heap, links, numbers, failed = read_heap(
            files, Path(folder), run, white, Journal(None, {}), say, 0
        )
    pairs = [(numbers[link.first], numbers[link.second]) for link in links]
    groups = connected(len(heap.images), [(link.first, link.second) for link in links])
    components = [[numbers[i] for i in group] for group in groups]
    return Groups(components, pairs, [str(f) for f in files], failed)


def read_heap(
    files: list[Path],
    notes: Path,
    run: tuple[Any, str],
    data_range: float | None,
    book: Journal,
    say: Progress,
    most: int,
) -> tuple[Heap, list[Link], list[int], dict[str, str]]:
    """Describe the photographs and link them.

    Return the heap of those that can be read, its links, their indices, and why the others failed.
    """
    started, place = run
    backend, _ = choice()
    there = [notes.absolute() / f"{n}.npz" for n in range(len(files))]
    tasks = [
        Task(str(file.absolute()), str(note), described, {"data_range": data_range}, backend, place)
        for file, note in zip(files, there, strict=True)
        if not note.exists()
    ]
    count = len(files)
    errors = errors_of(started, tasks, count, lambda n, _: say(n, 2 * count, "Keypoints"))
    failed = {str(f): errors[str(f.absolute())] for f in files if str(f.absolute()) in errors}
    numbers = [n for n, note in enumerate(there) if note.exists()]
    if not numbers:
        file, reason = next(iter(failed.items()))
        raise ValueError(f"paths must name images that can be read, got {file!r}: {reason}")
    kept = [there[n] for n in numbers]
    heap = heap_of([files[n] for n in numbers], kept, most)
    known = book.kept("links")
    if known is not None and known["numbers"].tolist() == numbers:
        return heap, _unpacked(known), numbers, failed
    rt = runtime(np.empty(0, np.uint8))
    links = link_features(rt, heap, Keypoints(kept), say, PAIRS)
    book.note("links", {"numbers": np.array(numbers)} | _packed(links))
    return heap, links, numbers, failed


def _packed(links: list[Link]) -> dict[str, np.ndarray]:
    table = [(k.first, k.second, k.overlapping, len(k.points0)) for k in links]
    none = np.zeros((0, 2))
    return {
        "table": np.array(table, np.int64).reshape(-1, 4),
        "matrices": np.array([k.matrix for k in links]).reshape(-1, 3, 3),
        "points0": np.concatenate([none, *(k.points0 for k in links)]),
        "points1": np.concatenate([none, *(k.points1 for k in links)]),
    }


def _unpacked(kept: dict[str, np.ndarray]) -> list[Link]:
    table = kept["table"]
    ends = np.cumsum(table[:, 3])
    return [
        Link(first, second, matrix, kept["points0"][a:b], kept["points1"][a:b], overlapping)
        for (first, second, overlapping, _), matrix, a, b in zip(
            table.tolist(), kept["matrices"], ends - table[:, 3], ends, strict=True
        )
    ]
