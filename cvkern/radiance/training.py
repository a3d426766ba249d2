"""From posed photographs to a radiance field."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._checks import (
    check_choice,
    check_code,
    check_flag,
    check_instance,
    check_integer,
    check_number,
    check_positive,
)
from cvkern._runtime import refuse_capture, runtime
from cvkern.kernels.codes.radiance import Background
from cvkern.radiance import checkpoints
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.fields.hash import HashField
from cvkern.radiance.fields.perceptron import MLPField
from cvkern.radiance.fields.voxel import VoxelField
from cvkern.radiance.models import Model, Training, load_model
from cvkern.radiance.scenes.photographs import Scene
from cvkern.radiance.trainer import Say, Trainer

__all__ = ["fit"]

Settings = VoxelField | HashField | MLPField
KINDS: dict[str, type[Settings]] = {"voxel": VoxelField, "hash": HashField, "mlp": MLPField}
# With these a step of 'hash' or 'mlp' takes about 30 ms on two cores; batches of the defaults are
# 16 and 4 times as large, and the perceptron of MLPField() some 20 times.
LINE = 10.0  # seconds between lines of progress in a log
ALIKE, UNIFORM = 6, 0.95  # grey levels off, and share of borders, of a background of one colour
ON_CPU: dict[str, dict[str, Any]] = {
    "hash": {"table_bits": 15, "samples": 2**14, "rays": 2**12, "cells": 64, "steps": 128},
    "mlp": {
        "width": 64, "layers": 4, "skip": 2, "frequencies": 6, "samples": 2**14, "cells": 32,
        "steps": 128, "learning_rate": 5e-3,
    },
}  # fmt: skip
# The defaults of a grid are for the CPU. A GPU has the time for a finer one, if not the memory.
ON_GPU: dict[str, dict[str, Any]] = {
    "voxel": {
        "resolutions": (32, 64, 128, 256), "shares": (0.05, 0.15, 0.4), "rays": 2**13,
        "smooth_color": 1e-10, "final_rate": 0.01,
    },
}  # fmt: skip
LAST_GRID = 11 * 10**9  # bytes, with the one before: a GPU with less is spared the last one


def fit(
    scene: Scene,
    field: str | Settings | None = None,
    *,
    seconds: float | None = None,
    steps: int | None = None,
    background: str | None = None,
    loss: str = "squared",
    spread: float = 0.0,
    seed: int = 0,
    deterministic: bool = False,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    save_every: float = 60.0,
    evaluate_every: int | None = None,
    progress: bool = True,
) -> Model:
    """Train a radiance field on the photographs of a scene.

    Parameters
    ----------
    scene : Scene
        Its views that are not kept back for testing are trained from.
    field : {'voxel', 'hash', 'mlp'}, or VoxelField, HashField or MLPField, optional
        What to train. A name is that of a field with settings that suit the device. On a GPU they
        are its defaults, but that 'voxel' goes on to a grid of 256 cells where 11 GB are free; on
        the CPU, where 'hash' and 'mlp' would take minutes to show anything, smaller ones. By
        default 'voxel' on the CPU, which mostly learns faster there, and 'hash' on a GPU.
    seconds : float, optional
        Time to train for, > 0, without the first step, which may have to compile kernels, looks
        at held-out views, and saving; 60 by default.
    steps : int, optional
        Batches to train on, instead of `seconds`. On the CPU the same steps give the same model,
        bit for bit, with the same number of threads.
    background : {'random', 'white', 'black', 'learnt'}, optional
        What is behind everything. Random colours keep the field from painting a background of its
        own: photographs with opacity come out with theirs, and others are filled to the last
        pixel. Where these show things before one colour, that colour or 'learnt' is much better. By
        default 'random', unless the photographs have no opacity and one colour all along their
        borders: then 'white', 'black' or 'learnt', as fits, which a warning says.
    loss : {'squared', 'huber'}, default 'squared'
        What is made small; Huber's is linear from errors of 0.1 on.
    spread : float, default 0.0
        A ray goes through a random point of its pixel, within a square of this side, from 0 (its
        centre) to 1 (all of it).
    seed : int, default 0
        Of all random numbers.
    deterministic : bool, default False
        On a GPU too, give the same model for the same `steps`, bit for bit, as long as the kind of
        GPU and the versions of its software stay the same. Steps take longer, and gradients twice
        the memory again: they are added up as integers, which have the same sum in any order.
    checkpoint : path, optional
        File, ``.npz``, that the model is saved to every now and then and at the end; each time
        whole or not at all. A run killed while it saves leaves a hidden ``.part.npz`` beside it.
    resume : bool, default False
        Go on from `checkpoint` if that is there, with the settings that it has: `field` must be
        equal to them, their kind, or None, and the `background`, the `seed` and the scene's bounds
        the same. Other options may change. `seconds` or `steps` count from the beginning.
    save_every : float, default 60.0
        Seconds between saves, > 0.
    evaluate_every : int, optional
        Steps between looks at a few held-out views, for ``model.training.marks``.
    progress : bool, default True
        Show a progress bar if the standard error is a terminal, and otherwise print a line every 10
        seconds.

    Returns
    -------
    Model
        On Ctrl-C, what there is by then (saved, if there is a `checkpoint`), with
        ``model.training.stopped`` set; a second Ctrl-C interrupts at once.

    Raises
    ------
    FileNotFoundError
        If the folder of `checkpoint` does not exist.
    OSError
        If `checkpoint` cannot be written.
    TypeError
        If an argument is of another kind.
    ValueError
        If an option is unknown or out of its range, both `seconds` and `steps` are given, the
        scene has no views to train from, images of 2 GiB or more in all or a camera more than 32768
        half-sides of its cube from the middle of that, or `checkpoint` has another ending or
        is a folder, or, to go on from, is not a whole model of the same settings.

    Notes
    -----
    Each step draws rays through random pixels of all views, as many as fill the field's room for
    samples. The launches of a step are recorded once, on CUDA as a graph.

    What is deterministic on a GPU counts gradients in units of 2^-28, after the loss has been
    multiplied by 128 (of a voxel field, by 4096). What is added at a time is cut off beyond 2^16,
    where half precision ends as well; with that, sums of 2^18 samples cannot overflow.

    Examples
    --------
    >>> from cvkern.radiance import HashField, fit, make_scene
    >>> scene = make_scene(train=3, test=1, size=16)
    >>> small = HashField(levels=8, table_bits=10, samples=2**12, rays=64, cells=32)
    >>> fit(scene, small, steps=2).training.step
    2
    """
    deterministic = check_flag(deterministic, "deterministic")
    resume = check_flag(resume, "resume")
    progress = check_flag(progress, "progress")
    refuse_capture("fit")
    if isinstance(field, str):
        check_choice(field, tuple(KINDS), "field")
    elif field is not None and not isinstance(field, tuple(KINDS.values())):
        raise TypeError(f"field must be settings such as HashField(), or a name, got {field!r}")
    check_instance(scene, Scene, "scene")
    if scene.images.size >= 2**31:  # kernels index bytes with 32 bits
        raise ValueError(
            f"scene must have images of less than 2 GiB in all, got shape {scene.images.shape}: "
            "scene.resized makes smaller ones"
        )
    if seconds is not None and steps is not None:
        raise ValueError(f"seconds must not be given with steps, got {seconds} and {steps}")
    if steps is not None:
        steps = check_integer(steps, "steps", 1, 2**31 - 1)
    else:
        seconds = check_positive(60.0 if seconds is None else seconds, "seconds")
    if background is not None:
        check_code(background, Background, "background")
    check_choice(loss, ("squared", "huber"), "loss")
    spread = check_number(spread, "spread", low=0.0)
    if spread > 1:
        raise ValueError(f"spread must lie in [0, 1], got {spread:g}")
    seed = check_integer(seed, "seed", 0, 2**31 - 1)
    save_every = check_positive(save_every, "save_every")
    if evaluate_every is not None:
        evaluate_every = check_integer(evaluate_every, "evaluate_every", 1, 2**31 - 1)
    if not (~scene.test).any():
        raise ValueError(f"scene must have views to train from, got {len(scene)} kept back")
    if checkpoint is not None:
        checkpoints.check_path(checkpoint)
    elif resume:
        raise ValueError("checkpoint must be given to resume from, got None")
    model = _begin(scene, field, background, seed, checkpoint if resume else None)
    if deterministic:
        model.field.make_deterministic()
    trainer = Trainer(model, scene, loss, spread)
    with _shown(progress) as say, _stoppable() as stop:
        trainer.train(seconds, steps, stop, say, checkpoint, save_every, evaluate_every)
    return model


def suited(field: str | None = None) -> Settings:
    """Return settings that suit the chosen device, of the kind of field called so or of any."""
    rt = runtime()
    on_cpu = rt.device == "cpu"
    name = field or ("voxel" if on_cpu else "hash")
    chosen = (ON_CPU if on_cpu else ON_GPU).get(name, {})
    if name == "voxel" and not on_cpu and rt.free_memory() < LAST_GRID:
        chosen = chosen | {key: chosen[key][:-1] for key in ("resolutions", "shares")}
    return KINDS[name](**chosen)


def _begin(
    scene: Scene, field: str | Settings | None, background: str | None, seed: int, checkpoint: Any
) -> Model:
    """Return a new model, or the one to go on with."""
    frame = Frame.of(scene)
    frame.inside(scene.cameras.poses)  # refuses distant ones before the work
    if checkpoint is not None and Path(checkpoint).exists():
        model = load_model(checkpoint)
        if not model.training.resumable:
            raise ValueError(
                f"checkpoint must be saved to go on with, got {os.fspath(checkpoint)!r}, which is "
                "for rendering alone"
            )
        settings = model.settings
        if isinstance(field, str) and isinstance(settings, KINDS[field]):
            field = settings
        for name, wanted, saved in (
            ("field", settings if field is None else field, settings),
            ("background", background or model.background, model.background),
            ("seed", seed, model.seed),
            ("scene", frame, model.frame),
        ):
            if saved != wanted:
                found, asked = _apart(saved, wanted), _apart(wanted, saved)
                raise ValueError(
                    f"checkpoint must be of the same {name}, got {found} instead of {asked}"
                )
        return model
    settings = suited(field) if field is None or isinstance(field, str) else field
    background = background or _seen_behind(scene)
    black = background == "black"
    behind = np.full(3, 0.0 if black else 0.5 if background == "learnt" else 1.0, np.float32)
    return Model(
        settings.build(runtime(), frame, seed), settings, background, behind, scene.cameras, seed,
        Training(), {},
    )  # fmt: skip


def _seen_behind(scene: Scene) -> str:
    """Return the background that suits the photographs, and say so if it is not 'random'."""
    if scene.images.shape[3] == 4:
        return "random"
    views = scene.images[~scene.test]
    sides = views[:, 0], views[:, -1], views[:, :, 0], views[:, :, -1]
    borders = np.concatenate(sides, axis=1)
    color = np.median(borders, axis=(0, 1))
    same = (np.abs(borders - color) <= ALIKE).all(axis=2).mean()
    if same < UNIFORM:
        return "random"
    white, black = (color >= 255 - ALIKE).all(), (color <= ALIKE).all()
    chosen = "white" if white else "black" if black else "learnt"
    warnings.warn(
        f"background is {chosen!r}, as {same:.0%} of the photographs' borders have one colour, "
        f"{tuple(color.astype(int).tolist())}: choose another by background=",
        stacklevel=4,
    )
    return chosen


def _apart(one: Any, other: Any) -> str:
    """Say what `one` is, where `other` is something else."""
    if not is_dataclass(one):
        return str(one)
    if type(one) is not type(other):
        return type(one).__name__
    pairs = ((f.name, getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return ", ".join(f"{name} {mine}" for name, mine, yours in pairs if mine != yours)


@contextlib.contextmanager
def _stoppable() -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into an event, in the main thread; the second is as ever."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, stack: Any) -> None:
        event.set()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, note)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


def _lines() -> Say:
    """Return a function that prints a line every LINE seconds, for logs."""
    last = time.monotonic()

    def say(share: float, text: str) -> None:
        nonlocal last
        if time.monotonic() - last >= LINE:
            last = time.monotonic()
            print(f"{share:.0%}  {text}", file=sys.stderr, flush=True)

    return say


@contextlib.contextmanager
def _shown(wanted: bool) -> Iterator[Say]:
    """Yield a function that shows how far the training is, if a terminal is there to show it."""
    if not wanted:
        yield lambda share, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines()
        return
    columns = (BarColumn(32), TextColumn("{task.description}"), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("Compiling", total=1.0)
        yield lambda share, text: bar.update(task, completed=share, description=text)
