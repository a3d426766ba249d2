"""One function over many files: on threads, processes, workers of Dask, or actors of Ray."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cvkern
from cvkern._checks import as_items, check_flag, check_integer
from cvkern._files import as_path
from cvkern._runtime import refuse_capture
from cvkern.images._formats import PHOTOGRAPHS
from cvkern.scale.engines import ARRAYS, Task, engine_of, errors_of, place_of


class Report(NamedTuple):
    """What became of each file of :func:`map_images`."""

    done: list[str]
    """Files whose result was written."""
    kept: list[str]
    """Files whose result was there already."""
    failed: dict[str, str]
    """The other files, with the reason of each."""


def map_images(
    paths: Any,
    function: Any,
    target: Any,
    *,
    suffix: str = ".npy",
    engine: Any = "threads",
    workers: int = 2,
    device: str | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> Report:
    """Apply a function to each of many image files, and write each result to a file.

    If a file cannot be read, the function fails, a disk is full, or a worker dies, the other files
    continue, and the report names each failure. Results are written whole or
    not at all, so the same call after a run that was killed does only what is left.

    Parameters
    ----------
    paths : path of a folder, or sequence of paths
        Image files (:func:`cvkern.images.read_image`). Of a folder, its photographs.
    function : function or str
        Called with an image, (H, W) or (H, W, C), and the options; or the name of a function of
        cvkern. Functions of cvkern that have it get ``channel_axis=-1`` for photographs in colour.
        For all engines but threads it must be picklable.
    target : path
        The folder of the results, which is made if need be. A result has the name of its file, with
        `suffix`.
    suffix : str, default '.npy'
        '.npy' for an array, '.npz' for a tuple of arrays (named by the fields of a named tuple), or
        an image format as '.png' (:func:`cvkern.images.write_image`).
    engine : {'threads', 'processes', 'dask', 'ray'} or distributed.Client, default 'threads'
        Processes are new ones: a script needs its ``if __name__ == "__main__"``. 'dask' starts that
        many workers on this machine, and a client uses the workers it has. 'ray' uses the cluster
        to which ``ray.init`` connected, or starts one on this machine. Workers must see the files
        under the same paths.
    workers : int, default 2
        Number of threads, processes, workers, or actors.
    device : str, optional
        As :class:`cvkern.use` takes it; by default that in use, with the kernel set in use. With
        'cuda', threads and processes share the GPUs of this machine in turn, and each actor of Ray
        has a GPU of its own. A worker of Dask uses the first GPU that its environment shows.
    overwrite : bool, default False
        Compute results that are there already once more.
    progress : callable, optional
        Called with the number of finished files and that of all of them.
    **options
        Passed to `function`.

    Returns
    -------
    Report
        `done`, `kept` and `failed`, in the order of `paths`.

    Raises
    ------
    ValueError
        If `paths` is empty, two files would have the same result, a result would replace a file of
        `paths`, the function, the engine or the device is unknown, or `suffix` is no format of
        results.
    TypeError
        If a path is not one.
    ImportError
        If the engine is not installed.
    FileNotFoundError
        If `paths` names no folder that exists.
    OSError
        If `target` cannot be made.

    Notes
    -----
    A file whose process, worker or actor died is tried again, three times at most in all, or as
    ``distributed.scheduler.allowed-failures`` says for Dask. Threads of Python hinder each other in
    short calls: several GPUs want processes or Ray.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from cvkern.images import write_image
    >>> from cvkern.scale import map_images
    >>> folder = tempfile.mkdtemp()
    >>> for n in range(3):
    ...     write_image(f"{folder}/{n}.png", np.full((20, 30), n, np.uint8))
    >>> report = map_images(folder, "gaussian", f"{folder}/blurred", sigma=2)
    >>> len(report.done), report.failed
    (3, {})
    """
    refuse_capture("scale.map_images")
    files = files_of(paths)
    call = _function(function)
    workers = check_integer(workers, "workers", 1, 4096)
    overwrite = check_flag(overwrite, "overwrite")
    formats = *ARRAYS, *PHOTOGRAPHS
    if not isinstance(suffix, str) or suffix not in formats:
        raise ValueError(f"suffix must be one of {', '.join(formats)}, got {suffix!r}")
    folder = as_path(target, "target")
    results = [folder / f"{file.stem}{suffix}" for file in files]
    if len(set(results)) < len(results):
        twice = next(r for r in results if results.count(r) > 1)
        raise ValueError(f"paths must have different names, got {twice.stem!r} twice")
    read = {file.resolve() for file in files}
    over = next((result for result in results if result.resolve() in read), None)
    if over is not None:
        raise ValueError(
            f"target must not hold a file of paths, got {str(over)!r}: take another folder"
        )
    backend, place = place_of(device)
    started = engine_of(engine, workers, place)
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [
        Task(str(file.absolute()), str(result.absolute()), call, options, backend, place)
        for file, result in zip(files, results, strict=True)
        if overwrite or not result.exists()
    ]
    errors = errors_of(started, tasks, len(files), progress)
    called = {task.path for task in tasks}
    named = [(str(file), str(file.absolute())) for file in files]
    return Report(
        [name for name, path in named if path in called and path not in errors],
        [name for name, path in named if path not in called],
        {name: errors[path] for name, path in named if path in errors},
    )


def files_of(paths: Any) -> list[Path]:
    """Return the files that are named, or those of a folder by name."""
    if isinstance(paths, (str, os.PathLike)):
        folder = as_path(paths, "paths")
        if not folder.is_dir():
            raise FileNotFoundError(f"paths must be a folder that exists, got {str(folder)!r}")
        files = sorted(f for f in folder.iterdir() if f.suffix.lower() in PHOTOGRAPHS)
    else:
        rule = "the path of a folder, or a sequence of paths"
        given = as_items(paths, "paths", rule)
        wrong = next((path for path in given if not isinstance(path, (str, os.PathLike))), None)
        if wrong is not None:
            got = type(wrong).__name__
            raise TypeError(f"paths must be {rule}, got {got} in {type(paths).__name__}")
        files = [as_path(path, "paths") for path in given]
    if not files:
        raise ValueError("paths must name at least one image, got none")
    return files


def _function(function: Any) -> Any:
    if callable(function):
        return function
    found = getattr(cvkern, function, None) if isinstance(function, str) else None
    if not callable(found):
        raise ValueError(f"function must be one, or the name of one of cvkern, got {function!r}")
    return found
