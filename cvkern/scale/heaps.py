"""One function over many files: on threads, processes, workers of Dask, or actors of Ray."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import cvkern
from cvkern._checks import as_items, check_flag, check_integer
from cvkern._files import as_path, replacing
from cvkern._runtime import choice, refuse_capture
from cvkern.images._formats import PHOTOGRAPHS
from cvkern.images.files import read_image, write_image

ARRAYS = ".npy", ".npz"
RETRIES = 2  # how often a file is tried again whose process or actor died


class Report(NamedTuple):
    """What became of each file of :func:`map_images`."""

    done: list[str]
    """Files whose result was written."""
    kept: list[str]
    """Files whose result was there already."""
    failed: dict[str, str]
    """The other files, with the reason of each."""


class Task(NamedTuple):
    """What a worker needs for one file."""

    path: str
    target: str
    function: Any
    options: dict[str, Any]
    backend: str
    device: str


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

    A file that cannot be read, a function that fails, a disk that is full, or a worker that dies
    ends nothing: the other files go on, and the report names each one. Results are written whole or
    not at all, so the same call after a run that was killed does only what is left.

    Parameters
    ----------
    paths : path of a folder, or sequence of paths
        Image files (:func:`cvkern.images.read_image`). Of a folder, its photographs.
    function : function or str
        Called with an image, (H, W) or (H, W, C), and the options; or the name of a function of
        cvkern. For all engines but threads it must be picklable.
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
    files = _files(paths)
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
    with cvkern.use(device=device):  # refuses a device that is not there
        backend, place = choice()
    place = "cuda" if device == "cuda" else place  # any GPU
    started = _engine(engine, workers, place)
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [
        Task(str(file.absolute()), str(result.absolute()), call, options, backend, place)
        for file, result in zip(files, results, strict=True)
        if overwrite or not result.exists()
    ]
    errors: dict[str, str] = {}
    with started as run:
        for n, (path, error) in enumerate(run(tasks)):
            if error:
                errors[path] = error
            if progress:
                progress(len(files) - len(tasks) + n + 1, len(files))
    called = {task.path for task in tasks}
    named = [(str(file), str(file.absolute())) for file in files]
    return Report(
        [name for name, path in named if path in called and path not in errors],
        [name for name, path in named if path not in called],
        {name: errors[path] for name, path in named if path in errors},
    )


def process(task: Task) -> str:
    """Compute and write the result of one file; return why it failed, or nothing."""
    try:
        with cvkern.use(task.backend, task.device):
            result = task.function(read_image(task.path), **task.options)
        _write(Path(task.target), result)
    except Exception as error:  # whatever it is, the other files go on
        return f"{type(error).__name__}: {error}"
    return ""


def _write(path: Path, result: Any) -> None:
    if path.suffix not in ARRAYS:
        write_image(path, result)
        return
    with replacing(path) as beside, open(beside, "wb") as stream:
        if path.suffix == ".npy":
            np.save(stream, np.asarray(result), allow_pickle=False)
        else:
            parts = result if isinstance(result, tuple) else (result,)
            names = getattr(parts, "_fields", [f"arr_{n}" for n in range(len(parts))])
            np.savez(stream, **dict(zip(names, map(np.asarray, parts), strict=True)))  # pyright: ignore[reportArgumentType]


def _files(paths: Any) -> list[Path]:
    """Return the files that are named, or those of a folder by name."""
    if isinstance(paths, (str, os.PathLike)):
        folder = as_path(paths, "paths")
        if not folder.is_dir():
            raise FileNotFoundError(f"paths must be a folder that exists, got {str(folder)!r}")
        files = sorted(f for f in folder.iterdir() if f.suffix.lower() in PHOTOGRAPHS)
    else:
        files = [as_path(path, "paths") for path in as_items(paths, "paths", "a folder or paths")]
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


def optional(module: str, user: str) -> Any:
    """Import a module that cvkern does not install by itself."""
    try:
        return import_module(module)
    except ImportError:
        raise ImportError(f"{user} needs {module}: pip install {module}") from None


Results = Iterator[tuple[str, str]]
"""The path of each finished file, and why it failed or nothing."""


def _engine(engine: Any, workers: int, device: str) -> Any:
    if engine == "threads":
        return _threads(workers, device)
    if engine == "processes":
        return _processes(workers, device)
    if engine == "ray":
        return _ray(workers, device)
    if engine == "dask" or hasattr(engine, "submit"):
        return _dask(workers, None if engine == "dask" else engine)
    kinds = "'threads', 'processes', 'dask', 'ray' or a client of Dask"
    raise ValueError(f"engine must be {kinds}, got {engine!r}")


def _places(device: str) -> list[str]:
    """Return the devices that workers of this machine take in turn."""
    return [d for d in cvkern.devices() if d != "cpu"] if device == "cuda" else [device]


@contextmanager
def _threads(workers: int, device: str) -> Iterator[Callable[[list[Task]], Results]]:
    places = _places(device)

    def run(tasks: list[Task]) -> Results:
        free = [places[n % len(places)] for n in range(workers)]
        waiting, running = iter(tasks), {}
        while True:
            while free and (task := next(waiting, None)):
                place = free.pop()
                running[pool.submit(process, task._replace(device=place))] = task.path, place
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                path, place = running.pop(future)
                free.append(place)
                yield path, future.result()

    with ThreadPoolExecutor(workers) as pool:
        yield run


@contextmanager
def _processes(workers: int, device: str) -> Iterator[Callable[[list[Task]], Results]]:
    places, context = _places(device), multiprocessing.get_context("spawn")
    # A pool for each process, because the death of one ends its whole pool.
    pools = [ProcessPoolExecutor(1, context) for _ in range(workers)]

    def run(tasks: list[Task]) -> Results:
        free, running = list(range(workers)), {}
        waiting = deque((task, 0) for task in tasks)
        while waiting or running:
            while free and waiting:
                at, (task, tries) = free.pop(), waiting.popleft()
                sent = task._replace(device=places[at % len(places)])
                running[pools[at].submit(process, sent)] = task, tries, at
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, tries, at = running.pop(future)
                free.append(at)
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    pools[at] = ProcessPoolExecutor(1, context)
                    if tries < RETRIES:
                        waiting.append((task, tries + 1))
                        continue
                yield task.path, f"{type(error).__name__}: {error}" if error else future.result()

    try:
        yield run
    finally:
        for pool in pools:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _dask(workers: int, client: Any) -> Iterator[Callable[[list[Task]], Results]]:
    distributed = optional("distributed", "engine 'dask'")
    cluster = None
    if client is None:
        cluster = distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None
        )
        client = distributed.Client(cluster)

    def run(tasks: list[Task]) -> Results:
        # What a worker was doing when it died goes to another one, by Dask's own rule.
        futures = {client.submit(process, task, pure=False): task.path for task in tasks}
        for future in distributed.as_completed(futures):
            error = future.exception()
            yield futures[future], f"{type(error).__name__}: {error}" if error else future.result()

    try:
        yield run
    finally:
        if cluster:
            client.close()
            cluster.close()


@contextmanager
def _ray(workers: int, device: str) -> Iterator[Callable[[list[Task]], Results]]:
    ray = optional("ray", "engine 'ray'")
    own = not ray.is_initialized()
    if own:
        ray.init(num_cpus=workers, include_dashboard=False, logging_level="error")
    cuda = device.startswith("cuda")
    remote = ray.remote(num_gpus=1 if cuda else 0, max_restarts=-1, max_task_retries=RETRIES)(
        _Actor
    )
    actors = [remote.remote() for _ in range(workers)]

    def run(tasks: list[Task]) -> Results:
        free, waiting, running = list(actors), iter(tasks), {}
        while True:
            while free and (task := next(waiting, None)):
                actor = free.pop()
                # An actor sees its own GPU only, as the first one.
                sent = task._replace(device="cuda" if cuda else device)
                running[actor.process.remote(sent)] = task.path, actor
            if not running:
                return
            for reference in ray.wait(list(running))[0]:
                path, actor = running.pop(reference)
                free.append(actor)
                try:
                    error = ray.get(reference)
                except ray.exceptions.RayError as reason:
                    error = f"{type(reason).__name__}: {reason}"
                yield path, error

    try:
        yield run
    finally:
        if own:
            ray.shutdown()
        else:
            for actor in actors:
                ray.kill(actor)


class _Actor:
    """A process of Ray that computes one file after the other."""

    def process(self, task: Task) -> str:
        return process(task)
