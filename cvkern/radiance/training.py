"""From posed photographs to a radiance field."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._runtime import refuse_capture, runtime
from cvkern._validate import check_choice, check_code, check_integer, check_number, check_positive
from cvkern.kernels.codes import Background
from cvkern.radiance import checkpoints
from cvkern.radiance.fields import Frame, Learning, Rays, Rendered
from cvkern.radiance.hash_field import BETAS, EPSILON, HashField
from cvkern.radiance.models import Mark, Model, Training, field_kind, load_model
from cvkern.radiance.parameters import Clip, Parameters
from cvkern.radiance.rendering import evaluate, on_device, owned
from cvkern.radiance.scenes import Scene
from cvkern.radiance.voxel_field import VoxelField

__all__ = ["fit"]

LOOK = 16  # steps between looks of the host at the device
SHARE = 1 / 4096  # of the sum of the losses of a batch is what is made small
HUBER = 0.1  # error of a channel from which Huber's loss grows linearly
BACKGROUND_RATE = 1e-2
PARTS = 256


def fit(
    scene: Scene,
    field: Any = None,
    *,
    seconds: float | None = None,
    steps: int | None = None,
    background: str = "random",
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
    field : VoxelField, HashField or MLPField, optional
        What to train; by default `VoxelField()` on the CPU, and `HashField()` on a GPU.
    seconds : float, optional
        Time to train for, > 0, without looks at held-out views and saving; 60 by default.
    steps : int, optional
        Batches to train on, instead of `seconds`. On the CPU the same steps give the same model,
        bit for bit, with the same number of threads.
    background : {'random', 'white', 'black', 'learnt'}, default 'random'
        What is behind everything. Random colours keep the field from painting a background of its
        own: photographs with opacity come out with theirs, and others are filled to the last
        pixel.
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
        whole or not at all.
    resume : bool, default False
        Go on from `checkpoint` if that is there; `seconds` or `steps` count from the beginning.
    save_every : float, default 60.0
        Seconds between saves, > 0.
    evaluate_every : int, optional
        Steps between looks at a few held-out views, for ``model.training.marks``.
    progress : bool, default True
        Show a progress bar if the standard error is a terminal.

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
        scene has no views to train from or images that do not fit its cameras, or `checkpoint` is
        not a whole model of the same settings.

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
    refuse_capture("fit")
    settings = default_field() if field is None else field
    if not hasattr(settings, "build"):
        raise TypeError(f"field must be settings such as HashField(), got {field!r}")
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {type(scene).__name__}")
    size = scene.cameras.height, scene.cameras.width
    if scene.images.dtype != np.uint8:
        raise TypeError(f"scene must have images of uint8, got {scene.images.dtype}")
    if scene.images.shape[:3] != (len(scene.cameras), *size) or scene.images.shape[3:] not in (
        (3,),
        (4,),
    ):
        raise ValueError(
            f"scene must have RGB or RGBA images of {size[0]} x {size[1]} pixels, one for each of "
            f"{len(scene.cameras)} cameras, got shape {scene.images.shape}"
        )
    if seconds is not None and steps is not None:
        raise ValueError(f"seconds must not be given with steps, got {seconds} and {steps}")
    if steps is not None:
        steps = check_integer(steps, "steps", 1, 2**31 - 1)
    else:
        seconds = check_positive(60.0 if seconds is None else seconds, "seconds")
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
        checkpoints.check_suffix(checkpoint)
    elif resume:
        raise ValueError("checkpoint must be given to resume from, got None")
    model = _begin(scene, settings, background, seed, checkpoint if resume else None)
    if deterministic:
        model.field.make_deterministic()
    trainer = Trainer(model, scene, loss, spread)
    with _shown(progress) as show, _stoppable() as stop:
        trainer.train(seconds, steps, stop, show, checkpoint, save_every, evaluate_every)
    return model


def default_field() -> Any:
    """Return settings that suit the chosen device."""
    return VoxelField() if runtime().device == "cpu" else HashField()


def field_called(name: str) -> Any:
    """Return the settings of the kind of field that the command calls so."""
    kinds = {"hash": "HashField", "voxel": "VoxelField", "mlp": "MLPField"}
    check_choice(name, tuple(kinds), "field")
    return field_kind(kinds[name])()


def _begin(scene: Scene, settings: Any, background: str, seed: int, checkpoint: Any) -> Model:
    """Return a new model, or the one to go on with."""
    frame = Frame.of(scene)
    if checkpoint is not None and Path(checkpoint).exists():
        model = load_model(checkpoint)
        if not model.training.resumable:
            raise ValueError(
                f"checkpoint must be saved to go on with, got {os.fspath(checkpoint)!r}, which is "
                "for rendering alone"
            )
        asked = {"field": settings, "background": background, "seed": seed, "scene": frame}
        found = (model.settings, model.background, model.seed, model.frame)
        for (name, wanted), saved in zip(asked.items(), found, strict=True):
            if saved != wanted:
                raise ValueError(
                    f"checkpoint must be of the same {name}, got {saved} instead of {wanted}"
                )
        return model
    black = background == "black"
    behind = np.full(3, 0.0 if black else 0.5 if background == "learnt" else 1.0, np.float32)
    return Model(
        settings.build(runtime(), frame, seed), settings, background, behind, scene.cameras, seed,
        Training(), {},
    )  # fmt: skip


class Trainer:
    """A model in training: the arrays on the device, and one step."""

    def __init__(self, model: Model, scene: Scene, loss: str, spread: float):
        self.model, self.scene, self.field = model, scene, model.field
        rt = self.rt = model.rt
        self.background = check_code(model.background, Background, "background")
        self.spread = spread
        self.huber = HUBER if loss == "huber" else 0.0
        used, count, state = ~scene.test, self.field.rays, model.training
        self.views = on_device(rt, model.frame, scene.cameras.select(used))
        images = scene.images[used]
        self.images = owned(rt, images.reshape(-1, images.shape[3]))
        self.size = scene.cameras.width, scene.cameras.height
        self.active = owned(rt, np.array([state.rays or self.field.first_rays], np.int32))
        self.rays = Rays(rt.zeros((count, 3)), rt.zeros((count, 3)), self.active)
        self.targets, self.errors = rt.zeros((count, 4)), rt.zeros((count,))
        self.gradients = Rendered(*(rt.zeros((count, *tail)) for tail in ((3,), (), (), ())))
        self.behind = Parameters(rt, model.behind, np.dtype(np.float32))
        if "behind.values" in model.extra:
            self.behind.restore("behind.", model.extra, rt)
        self.d_behind, self.parts = rt.zeros((count, 3)), rt.zeros((PARTS, 3))
        self.rate, self.clip = rt.zeros((3,)), Clip(rt, None)
        self.learning = Learning(
            owned(rt, np.array([state.step], np.int32)),
            owned(rt, np.array([state.progress], np.float32)),
            SHARE,
        )
        state.rays = state.rays or self.field.first_rays
        self._step: Any = None
        self._edition = -1

    def step(self) -> None:
        """Draw rays, render them, and learn from the errors."""
        rt, field, at = self.rt, self.field, self.learning.step
        rt.radiance_rays.random_rays(
            *self.views, self.images, *self.size, self.spread, self.model.seed, at, *self.rays[:2],
            self.targets,
        )  # fmt: skip
        seen = field.forward(self.rays, at)
        rt.radiance_loss.loss(
            seen.color, seen.opacity, self.targets, self.active, self.background,
            self.behind.values, self.huber, field.gradient_scale, self.model.seed, at, self.errors,
            self.gradients.color, self.gradients.opacity, self.d_behind,
        )  # fmt: skip
        field.backward(self.gradients)
        field.learn(self.learning)
        if self.background == Background.LEARNT:
            adam = rt.radiance_adam
            rt.radiance_background.gather(
                self.d_behind, self.active, self.parts, self.behind.gradients
            )
            adam.learning_rate(
                at, self.learning.progress, BACKGROUND_RATE, 1, 0.1, *BETAS, self.rate
            )
            self.clip.update(SHARE / field.gradient_scale)
            given = self.rate, self.clip.factor, *BETAS, EPSILON, 0.0, False
            adam.adam(*given, *self.behind.flat())
        rt.radiance_adam.advance(at)

    def repeat(self) -> None:
        """Take a step: the first one with the field's arrays as it is, the others as recorded."""
        if self._edition != self.field.edition:
            self._edition = self.field.edition
            self.step()
            self._step = self.rt.record(self.step)
        else:
            self._step()

    def train(
        self,
        seconds: float | None,
        steps: int | None,
        stop: threading.Event,
        show: Any,
        checkpoint: Any,
        save_every: float,
        evaluate_every: int | None,
    ) -> None:
        """Take steps until the budget is spent."""
        state, at = self.model.training, self.learning.step
        state.stopped, first = False, state.step
        before, begin, saved, quality = state.seconds, time.perf_counter(), state.seconds, math.nan

        def spent() -> float:
            return before + time.perf_counter() - begin

        while (state.step < steps if steps else spent() < (seconds or 0)) and not stop.is_set():
            self.field.tend(state.step, self.learning)
            self.repeat()
            state.step += 1
            state.total_rays += state.rays
            looks = state.step % LOOK == 0
            evaluates = evaluate_every is not None and state.step % evaluate_every == 0
            if looks or evaluates:
                quality = self.quality()
            if looks:
                samples = self.field.taken()
                state.total_samples += LOOK * samples
                state.rays = self.field.rays_for(samples, state.rays)
                state.progress = min(1.0, state.step / steps if steps else spent() / (seconds or 1))
                self.rt.write(self.active, np.array([state.rays], np.int32))
                self.rt.write(self.learning.progress, np.array([state.progress], np.float32))
                show(state, quality, spent())
            file = checkpoint if looks and spent() - saved >= save_every else None
            if evaluates or file is not None:
                self.rt.to_numpy(at)  # what was launched is done, and paid for
                state.seconds, paused = spent(), time.perf_counter()
                if evaluates:
                    self.mark(quality, 4)
                if file is not None:
                    self.keep()
                    self.model.save(file)
                    saved = state.seconds
                begin += time.perf_counter() - paused
        self.rt.to_numpy(at)
        state.seconds, state.stopped = spent(), stop.is_set()
        try:
            if not state.stopped and (state.step > first or not state.marks):
                self.mark(quality, None)
        finally:  # an interrupt of the looks at held-out views must not cost the training
            self.keep()
            if checkpoint is not None:
                self.model.save(checkpoint)

    def quality(self) -> float:
        """Return the signal-to-noise ratio of the last batch, decibels."""
        error = float(self.rt.to_numpy(self.errors)[: self.model.training.rays].mean())
        return -10 * math.log10(max(error, 1e-12))

    def mark(self, quality: float, most: int | None) -> None:
        """Note how good the model is by now, by at most so many of the held-out views."""
        self.keep()
        state, views = self.model.training, np.flatnonzero(self.scene.test)
        if most is not None:
            views = views[:: -(-len(views) // most)] if len(views) else views
        found = [math.nan, math.nan]
        if len(views):
            scores = evaluate(self.model, self.scene, views=views.tolist())
            found = [float(part.mean()) for part in scores]
        if state.marks and state.marks[-1].step == state.step:
            state.marks.pop()  # fewer views, or the end of a budget that is spent again
        state.marks.append(Mark(state.step, state.seconds, quality, *found))

    def keep(self) -> None:
        """Take from the device what the model has beside the field."""
        if self.background == Background.LEARNT:
            self.model.extra = self.behind.state("behind.", self.rt)
            self.model.behind = self.model.extra["behind.values"].clip(0, 1)


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


@contextlib.contextmanager
def _shown(wanted: bool) -> Iterator[Any]:
    """Yield a function that shows how far the training is."""
    if not wanted:
        yield lambda *seen: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(32), TextColumn("{task.description}"), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("Compiling", total=1.0)
        last = [0.0]

        def show(state: Training, quality: float, spent: float) -> None:
            rate, last[0] = LOOK * state.rays / max(spent - last[0], 1e-9), spent
            said = f"{quality:.1f} dB  {rate / 1e3:,.0f} k rays/s"
            bar.update(task, completed=state.progress, description=said)

        yield show
