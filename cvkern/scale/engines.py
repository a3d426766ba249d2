"""Tasks of one file each: on threads, processes, workers of Dask, or actors of Ray."""

from __future__ import annotations

import inspect
import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

import cvkern
from cvkern._files import replacing
from cvkern._runtime import choice
from cvkern.images.files import read_image, write_image

ARRAYS = ".npy", ".npz"
RETRIES = 2  # how often a file is tried again whose process or actor died


class Task(NamedTuple):
    """What a worker needs for one file."""

    path: str
    target: str
    function: Any
    options: dict[str, Any]
    backend: str
    device: str


def place_of(device: str | None) -> tuple[str, str]:
    """Return the kernel set and the device of tasks; refuse a device that is not there."""
    with cvkern.use(device=device):
        backend, place = choice()
    return backend, "cuda" if device == "cuda" else place  # any GPU


def errors_of(
    started: Any,
    tasks: list[Task],
    count: int,
    progress: Callable[[int, int], object] | None,
) -> dict[str, str]:
    """Do the tasks of an engine, the last ones of `count`; return why files failed."""
    errors: dict[str, str] = {}
    with started as run:
        for n, (path, error) in enumerate(run(tasks)):
            if error:
                errors[path] = error
            if progress:
                progress(count - len(tasks) + n + 1, count)
    return errors


def process(task: Task) -> str:
    """Compute and write the result of one file; return why it failed, or nothing."""
    try:
        image = read_image(task.path)
        options = with_channels(task.function, image.shape, task.options)
        with cvkern.use(task.backend, task.device):
            result = task.function(image, **options)
        _write(Path(task.target), result)
    except Exception as error:  # whatever it is, the other files go on
        return f"{type(error).__name__}: {error}"
    return ""


def with_channels(function: Any, shape: tuple[int, ...], options: dict[str, Any]) -> dict[str, Any]:
    """Return the options for an image from a file: its colours are the last axis.

    Functions of cvkern refuse to guess that of an array, but files have no other order.
    """
    if len(shape) != 3 or not getattr(function, "__module__", "").startswith("cvkern."):
        return options
    if "channel_axis" not in inspect.signature(function).parameters:
        return options
    return {"channel_axis": -1} | options


def _write(path: Path, result: Any) -> None:
    if path.suffix not in ARRAYS:
        write_image(path, result)
        return
    with replacing(path) as beside, open(beside, "wb") as stream:
        if path.suffix == ".npy":
            # Given a file, NumPy writes by itself, and does not say that the disk is full.
            plain: Any = SimpleNamespace(write=stream.write)
            np.save(plain, np.asarray(result), allow_pickle=False)
        else:
            parts = result if isinstance(result, tuple) else (result,)
            names = getattr(parts, "_fields", [f"arr_{n}" for n in range(len(parts))])
            np.savez(stream, **dict(zip(names, map(np.asarray, parts), strict=True)))  # pyright: ignore[reportArgumentType]


def optional(module: str, user: str) -> Any:
    """Import a module that cvkern does not install by itself."""
    try:
        return import_module(module)
    except ImportError:
        raise ImportError(f"{user} needs {module}: pip install {module}") from None


Results = Iterator[tuple[str, str]]
"""The path of each finished file, and why it failed or nothing."""


def engine_of(engine: Any, workers: int, device: str) -> Any:
    """Return a context that gives a function from tasks to results."""
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
