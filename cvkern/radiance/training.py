"""From posed photographs to a radiance field."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Sequence
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
from cvkern._runtime import check_devices, refuse_capture, runtime, use
from cvkern.kernels.codes.radiance import Background
from cvkern.radiance import checkpoints, logs
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.fields.hash import HashField
from cvkern.radiance.fields.perceptron import MLPField
from cvkern.radiance.fields.planes import PlanesField
from cvkern.radiance.fields.splats import SplatField
from cvkern.radiance.fields.voxel import VoxelField
from cvkern.radiance.models import Model, Training, built, load_model
from cvkern.radiance.progress import shown, stoppable
from cvkern.radiance.scenes.backgrounds import color_behind, seen_behind
from cvkern.radiance.scenes.photographs import Scene
from cvkern.radiance.trainer import Trainer
from cvkern.radiance.wild.options import Wild, check_whole, check_wild

__all__ = ["fit"]

Settings = VoxelField | HashField | MLPField | PlanesField | SplatField
KINDS: dict[str, type[Settings]] = {
    "voxel": VoxelField, "hash": HashField, "mlp": MLPField, "planes": PlanesField,
    "splats": SplatField,
}  # fmt: skip
# With these settings, a step of 'hash' or 'mlp' takes about 30 ms on two cores. The default batches
# are 16 and 4 times as large, and the default perceptron of MLPField() about 20 times.
ON_CPU: dict[str, dict[str, Any]] = {
    "hash": {"table_bits": 15, "samples": 2**14, "rays": 2**12, "cells": 64, "steps": 128},
    "mlp": {
        "width": 64, "layers": 4, "skip": 2, "frequencies": 6, "samples": 2**14, "cells": 32,
        "steps": 128, "learning_rate": 5e-3,
    },
    "splats": {"splats": 2**13},
}  # fmt: skip
# The defaults of a grid are for the CPU. A GPU is fast enough for a finer one if the memory allows.
ON_GPU: dict[str, dict[str, Any]] = {
    "voxel": {
        "resolutions": (32, 64, 128, 256), "shares": (0.05, 0.15, 0.4), "rays": 2**13,
        "smooth_color": 1e-10, "final_rate": 0.01,
    },
}  # fmt: skip
LAST_GRID = 11 * 10**9  # bytes of the last two grids; a GPU with less omits the last one


def fit(
    scene: Scene,
    field: str | Settings | None = None,
    *,
    seconds: float | None = None,
    steps: int | None = None,
    background: str | None = None,
    loss: str = "squared",
    spread: float = 0.0,
    appearance: str | None = None,
    gauge: int | None = None,
    robust: bool = False,
    transient: bool = False,
    seed: int = 0,
    deterministic: bool = False,
    devices: Sequence[str] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    save_every: float = 60.0,
    evaluate_every: int | None = None,
    callback: Callable[[int, float, Model], Any] | None = None,
    log: str | os.PathLike[str] | None = None,
    progress: bool = True,
    viewer: bool = False,
) -> Model:
    """Train a radiance field on the photographs of a scene.

    Parameters
    ----------
    scene : Scene
        The scene; its views that are not held out for testing are used for training.
    field : {'voxel', 'hash', 'mlp', 'planes', 'splats'}, or their settings, optional
        The field to train. A name means a field with settings that suit the device. On a GPU these
        are the field's defaults, except that 'voxel' continues to a grid of 256 cells if 11 GB are
        free. On the CPU they are smaller, because 'hash' and 'mlp' would otherwise take minutes to
        show anything. By default 'voxel' on the CPU, where it mostly learns faster, and 'hash' on
        a GPU.
    seconds : float, optional
        Training time, > 0; 60 by default. What planes and splats begin with, the first step, which
        may compile kernels, evaluation of held-out views, and saving are not counted.
    steps : int, optional
        Number of batches, instead of `seconds`. On the CPU the same steps give the same model, bit
        for bit, with the same number of threads.
    background : {'random', 'white', 'black', 'learnt'}, optional
        Background of the scene. Random colours prevent the field from modelling a background:
        photographs with opacity are learnt with their opacity, and others as opaque in every pixel.
        For photographs without opacity that show objects in front of one colour, that colour or
        'learnt' is much better; it begins with the median colour of their borders. By default
        'random', unless the photographs have no opacity and one colour along all borders: then
        'white', 'black' or 'learnt', and a warning names the choice.
    loss : {'squared', 'huber'}, default 'squared'
        The loss to minimise; Huber's is linear for errors above 0.1.
    spread : float, default 0.0
        A ray goes through a random point of its pixel, within a square of this side, from 0 (its
        centre) to 1 (the whole pixel).
    appearance : {'affine', 'embedding'}, optional
        Learn the light of each photograph, for photographs of changing light or exposure. 'affine'
        learns a matrix (A, b) for each, which maps the colours c of the field to A c + b before
        they are compared with the photograph. 'embedding' learns 16 numbers for each, inputs of
        the perceptron of colours of a 'hash' or 'mlp' field: light may then change in parts of the
        scene. See ``model.appearances`` and :func:`render`.
    gauge : int, optional
        The number of the photograph, among all of the scene, whose light pictures have by default.
        By default the first one that is trained on.
    robust : bool, default False
        Ignore what does not stay, such as passers-by: a pixel counts as much as it is likely to
        show the scene, by its error and those of its neighbourhood. See ``model.weights``.
    transient : bool, default False
        Learn what passes in front of each photograph: a colour, an opacity and a doubt for every
        few pixels, as the transient head of NeRF-W. See :func:`render_transient`.
    seed : int, default 0
        Seed of all random numbers.
    deterministic : bool, default False
        Give the same model for the same `steps`, bit for bit, on a GPU too, as long as the kind of
        GPU and the versions of its software stay the same. Steps take longer, and gradients take
        three times the memory: they are added as integers, whose sum does not depend on the order.
    devices : sequence of str, optional
        Train on several GPUs together, such as ``("cuda:0", "cuda:1")``: batches are so many times
        as large. Gradients are added by NCCL where CuPy or PyTorch is installed, and by the host
        otherwise. The model is on the first one. By default the device in use.
    checkpoint : path, optional
        File, ``.npz``, to which the model is saved periodically and at the end, each time whole or
        not at all. A run that is killed while it saves leaves a hidden ``.part.npz`` beside it.
    resume : bool, default False
        Continue from `checkpoint` if it exists, with its settings: `field` must be equal to them,
        name their kind, or be None, and the `background`, the `seed` and the scene's bounds must be
        the same. Other options may change. `seconds` or `steps` count from the beginning.
    save_every : float, default 60.0
        Seconds between saves, > 0.
    evaluate_every : int, optional
        Steps between evaluations of a few held-out views, for ``model.training.marks``.
    callback : function, optional
        Called as ``callback(step, loss, model)`` after every 16th step, and at the end; the loss is
        the mean squared error of the colours of the last batch. The model can be rendered then; the
        time that this takes is not counted. If the result is True, training ends as after Ctrl-C.
        If it raises an exception, so does ``fit``, and `checkpoint` stays as it was last saved.
    log : path, optional
        File, ``.csv``, to which a line is added every 16 steps: step, seconds, loss, psnr,
        rays_per_second, and test_psnr and test_ssim where held-out views were looked at. It is
        replaced, or continued if `resume` is set. A path without an ending is a folder for
        TensorBoard, which needs PyTorch.
    progress : bool, default True
        Show a progress bar if the standard error is a terminal, and otherwise print a line every 10
        seconds.
    viewer : bool, default False
        Show the field while it trains, on a page in the browser of this machine; its address is
        printed. Needs viser. ``cvkern view`` shows a model afterwards.

    Returns
    -------
    Model
        The trained model. After Ctrl-C, it is the model so far (saved, if there is a `checkpoint`),
        with ``model.training.stopped`` set. A second Ctrl-C interrupts at once.

    Raises
    ------
    FileNotFoundError
        If the folder of `checkpoint` or `log` does not exist.
    ModuleNotFoundError
        If `log` is for TensorBoard, which is not installed.
    OSError
        If `checkpoint` or `log` cannot be written.
    TypeError
        If an argument has the wrong type.
    ImportError
        If viser is not installed for `viewer`.
    ValueError
        If an option is unknown or out of its range; if both `seconds` and `steps` are given; if the
        scene has no training views, images of 2 GiB or more together, or a camera more than 32768
        half-sides of its cube from the cube's middle; if `checkpoint` or `log` has another ending,
        or `checkpoint` is a folder; or if, to resume, it is not a whole model with the same
        settings.

    Notes
    -----
    Each step draws rays through random pixels of all views, as many as fill the field's room for
    samples, or, for splats, takes a photograph. The launches of a step are recorded once, on CUDA
    as a graph.

    Deterministic training on a GPU adds gradients in units of 2^-28, after the loss has been
    multiplied by 128 (4096 for a voxel field). Each summand is clipped to 2^16, the limit of half
    precision, so that sums of 2^18 samples cannot overflow.

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
    viewer = check_flag(viewer, "viewer")
    refuse_capture("fit")
    if isinstance(field, str):
        check_choice(field, tuple(KINDS), "field")
    elif field is not None and not isinstance(field, tuple(KINDS.values())):
        raise TypeError(f"field must be settings such as HashField(), or a name, got {field!r}")
    _check_scene(scene)
    seconds, steps = _check_length(seconds, steps)
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
    if checkpoint is not None:
        checkpoints.check_path(checkpoint)
    elif resume:
        raise ValueError("checkpoint must be given to resume from, got None")
    wild = check_wild(scene, loss, Wild(appearance, gauge, robust, transient))
    places = check_devices(devices)
    if wild.robust and len(places) > 1:
        raise ValueError(f"robust must not go with several devices, got {len(places)}")
    if callback is not None and not callable(callback):
        raise TypeError(f"callback must be a function, got {type(callback).__name__}")
    to = None if log is None else logs.check_log(log)

    models: list[Model] = []
    for place in places:
        with use(device=place):
            known = models[0].background if models else background  # warns once
            start = _begin(scene, field, known, seed, wild, spread, checkpoint if resume else None)
            models.append(start)
    if deterministic:
        for one in models:
            one.field.make_deterministic()
    model = models[0]
    exact = deterministic and model.rt.device != "cpu"
    others = [Trainer(one, scene, loss, spread, exact) for one in models[1:]]
    trainer = Trainer(model, scene, loss, spread, exact, others)
    with contextlib.ExitStack() as stack:
        write = stack.enter_context(logs.opened(to, resume)) if to is not None else None
        say, stop = stack.enter_context(shown(progress)), stack.enter_context(stoppable())
        if viewer:
            from cvkern.app.viewer.fields import shown_while_training

            callback = stack.enter_context(shown_while_training(model, callback, _told))
        watch = _watched(callback, write, model)
        trainer.train(seconds, steps, stop, say, checkpoint, save_every, evaluate_every, watch)
    return model


def _check_scene(scene: Scene) -> None:
    """Check that there is something to train from, which kernels can index."""
    check_instance(scene, Scene, "scene")
    if scene.images.size >= 2**31:  # kernels index bytes with 32 bits
        raise ValueError(
            f"scene must have images of less than 2 GiB in all, got shape {scene.images.shape}: "
            "scene.resized makes smaller ones"
        )
    if not (~scene.test).any():
        raise ValueError(f"scene must have views to train from, got {len(scene)} held out")
    if scene.masks is not None and not scene.masks[~scene.test].any():
        raise ValueError("scene must have pixels to train from, got masks without any")


def _check_length(seconds: float | None, steps: int | None) -> tuple[float | None, int | None]:
    """Check how long to train; return `seconds` or `steps`, and None for the other."""
    if seconds is not None and steps is not None:
        raise ValueError(f"seconds must not be given with steps, got {seconds} and {steps}")
    if steps is not None:
        return None, check_integer(steps, "steps", 1, 2**31 - 1)
    return check_positive(60.0 if seconds is None else seconds, "seconds"), None


def _told(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _watched(
    callback: Callable[[int, float, Model], Any] | None, write: logs.Write | None, model: Model
) -> logs.Watch | None:
    """Return a function that writes each step to a log, and calls the callback."""
    if callback is None and write is None:
        return None
    told = -1

    def watch(look: logs.Look) -> bool:
        nonlocal told
        if write is not None:
            write(look)
        if callback is None or look.step == told:
            return False
        told = look.step
        return callback(look.step, look.loss, model) is True

    return watch


def suited(field: str | None = None) -> Settings:
    """Return settings that suit the chosen device, for the named kind of field or the default."""
    rt = runtime()
    on_cpu = rt.device == "cpu"
    name = field or ("voxel" if on_cpu else "hash")
    chosen = (ON_CPU if on_cpu else ON_GPU).get(name, {})
    if name == "voxel" and not on_cpu and rt.free_memory() < LAST_GRID:
        chosen = chosen | {key: chosen[key][:-1] for key in ("resolutions", "shares")}
    return KINDS[name](**chosen)


def _begin(
    scene: Scene,
    field: str | Settings | None,
    background: str | None,
    seed: int,
    wild: Wild,
    spread: float,
    checkpoint: Any,
) -> Model:
    """Return a new model, or the one to continue with."""
    frame = Frame.of(scene)
    frame.inside(scene.cameras.poses)  # refuses distant cameras before the work
    if checkpoint is not None and Path(checkpoint).exists():
        model = load_model(checkpoint)
        if not model.training.resumable:
            raise ValueError(
                f"checkpoint must be resumable, got {os.fspath(checkpoint)!r}, which is for "
                "rendering only"
            )
        settings = model.settings
        if isinstance(field, str) and isinstance(settings, KINDS[field]):
            field = settings
        for name, wanted, saved in (
            ("field", settings if field is None else field, settings),
            ("background", background or model.background, model.background),
            ("seed", seed, model.seed),
            ("appearance", wild.appearance or model.appearance, model.appearance),
            ("gauge", model.gauge if wild.gauge is None else wild.gauge, model.gauge),
            ("robust", wild.robust or model.robust, model.robust),
            ("transient", wild.transient or model.transient, model.transient),
            ("scene", frame, model.frame),
        ):
            if saved != wanted:
                found, asked = _apart(saved, wanted), _apart(wanted, saved)
                raise ValueError(
                    f"checkpoint must be of the same {name}, got {found} instead of {asked}"
                )
        if model.field.whole:
            check_whole(scene, spread, model)
        return model
    settings = suited(field) if field is None or isinstance(field, str) else field
    background = background or seen_behind(scene)
    behind = color_behind(scene, background)
    gauge = int(np.flatnonzero(~scene.test)[0]) if wild.gauge is None else wild.gauge
    made = built(settings, frame, seed, wild.appearance)
    if made.whole:
        check_whole(scene, spread, wild)
    made.start(scene, {"background": background, **wild._asdict()})
    return Model(
        made, settings, background, behind, scene.cameras, seed,
        Training(), {}, wild.appearance, gauge, wild.robust, wild.transient,
    )  # fmt: skip


def _apart(one: Any, other: Any) -> str:
    """Return the values of `one` that differ from those of `other`, as text."""
    if not is_dataclass(one):
        return str(one)
    if type(one) is not type(other):
        return type(one).__name__
    pairs = ((f.name, getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return ", ".join(f"{name} {mine}" for name, mine, yours in pairs if mine != yours)
