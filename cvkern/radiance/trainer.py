"""A model in training: the arrays on the device, one step, and the loop around it."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cvkern._checks import check_code
from cvkern.kernels.codes.radiance import AdamRule, Background, Comparison, Composited, Rays
from cvkern.radiance.devices import adder
from cvkern.radiance.fields.field import Learning
from cvkern.radiance.fields.hash import BETAS, EPSILON
from cvkern.radiance.fields.parameters import Clip, Parameters
from cvkern.radiance.logs import Look, Watch
from cvkern.radiance.models import APPEARANCE, TRANSIENT, Mark, Model
from cvkern.radiance.progress import Say
from cvkern.radiance.rendering import evaluate, on_device, owned
from cvkern.radiance.scenes.photographs import Scene
from cvkern.radiance.wild.appearance import Appearance, fit_gauge
from cvkern.radiance.wild.distractors import DISTRACTORS, Distractors
from cvkern.radiance.wild.embeddings import Embedding
from cvkern.radiance.wild.transient import Passing

LOOK = 16  # steps between checks of the device by the host
CLOCK = 0.005  # change of the progress (a share of the time) after which the device gets an update
# The loss of a batch is the sum over its rays times this, not their mean, so that a ray has the
# same weight in a large batch as in a small one.
SHARE = 1 / 4096
HUBER = 0.1  # error of a channel above which Huber's loss grows linearly
BACKGROUND_RATE = 1e-3  # learning rate of a learnt background, which begins near its colour
PARTS = 256  # partial sums of the background's gradient
# Share of a training in light that changes during which colours are the same from all sides, or the
# field would take the light of each photograph for one more side of the scene. Then the lights stay
# as they are: sides and lights could change together without any effect on the photographs.
SAME = 0.5
# Error of a channel above which the loss grows linearly during that share. Highlights move over
# surfaces, so they are errors of colours that are the same from all sides, and must not count as a
# photograph's light.
GLOSS = 0.03
FEW = 4  # held-out views of an evaluation during training


class Trainer:
    """The steps of a training; see :func:`cvkern.radiance.fit` for the parameters."""

    def __init__(
        self,
        model: Model,
        scene: Scene,
        loss: str,
        spread: float,
        exact: bool = False,
        others: Sequence[Trainer] = (),
    ):
        """Begin, or go on; on a GPU, gradients are the same in every run if `exact`.

        `others` are trainers of the same model on further devices, which take each step as well.
        """
        self.model, self.scene, self.field = model, scene, model.field
        self.others = tuple(others)
        for rank, one in enumerate(others, 1):
            one.seed, one.learning = model.seed + rank, one.learning._replace(scale=self._share())
        self.seed = model.seed
        self.add = adder([one.model.rt for one in self.team])
        rt = self.rt = model.rt
        self.background = check_code(model.background, Background, "background")
        self.spread = spread
        self.huber = HUBER if loss == "huber" else 0.0
        used, state = ~scene.test, model.training
        self.views = on_device(rt, model.frame, scene.cameras.select(used))
        self.field.begin(self.views)
        count = self.field.rays
        images = scene.images[used]
        self.images = owned(rt, images.reshape(-1, images.shape[3]))
        chosen = np.array([-1], np.int32)  # all pixels
        if scene.masks is not None:
            chosen = np.flatnonzero(scene.masks[used]).astype(np.int32)
        self.chosen, self.masks = owned(rt, chosen), None
        if scene.masks is not None and self.field.whole:
            self.masks = owned(rt, scene.masks[used].reshape(-1).astype(np.uint8))
        self.places = rt.zeros((count,), np.int32), rt.zeros((count,), np.int32)
        state.rays = state.rays if state.step else self.field.first_rays
        self.active = owned(rt, np.array([state.rays], np.int32))
        self.rays = Rays(rt.zeros((count, 3)), rt.zeros((count, 3)), self.active)
        self.targets, self.errors = rt.zeros((count, 4)), rt.zeros((count,))
        self.gradients = Composited(*(rt.zeros((count, *tail)) for tail in ((3,), (), (), ())))
        self.behind = Parameters(rt, model.behind, np.dtype(np.float32))
        if "behind.values" in model.extra:
            self.behind.restore("behind.", model.extra, rt)
        views = np.flatnonzero(used).astype(np.int32)
        self.appearance: Appearance | Embedding | None = None
        if model.appearance is not None:
            kind = Embedding if model.appearance == "embedding" else Appearance
            self.appearance = kind(rt, len(views), count)
            if model.extra.get(APPEARANCE + "values") is not None:
                self.appearance.restore(model.extra)
            model.extra[APPEARANCE + "views"] = views
        self.distractors = None
        if model.robust:
            self.distractors = Distractors(rt, images.shape[:3], count)
            if DISTRACTORS + "share" in model.extra:
                self.distractors.restore(model.extra)
            model.extra[DISTRACTORS + "views"] = views
        self.passing = None
        if model.transient:
            self.passing = Passing(rt, images.shape[:3], count, exact)
            if TRANSIENT + "values" in model.extra:
                self.passing.restore(model.extra)
            model.extra[TRANSIENT + "views"] = views
        self.d_behind, self.parts = rt.zeros((count, 3)), rt.zeros((PARTS, 3))
        self.rate, self.clip = rt.zeros((3,)), Clip(rt, None)
        self.learning = Learning(
            owned(rt, np.array([state.step], np.int32)),
            rt.zeros((1,)),
            self._share(),
        )
        self.settled = False  # whether the lights of photographs are no longer learnt
        self._parts: dict[str, Callable[[], None]] = {}
        self._edition = -1

    @property
    def team(self) -> list[Trainer]:
        """The trainers of all devices."""
        return [self, *self.others]

    def _share(self) -> float:
        """Return the weight of a ray: on several devices, batches are so many times as large."""
        return SHARE / (1 + len(self.others))

    def step(self) -> None:
        """Draw rays, render them, and learn from the errors."""
        self.compare()
        self.learn()

    def compare(self) -> None:
        """Draw rays, render them, and propagate the errors back to gradients."""
        rt, field, at = self.rt, self.field, self.learning.step
        if field.whole:
            field.photograph(self.images, self.seed, at, self.targets, self.places)
        else:
            rt.radiance.pinhole.random_rays(
                self.views, self.images, self.spread, self.seed, at, self.chosen, *self.rays[:2],
                self.targets, *self.places,
            )  # fmt: skip
        light = self.appearance
        if isinstance(light, Embedding):
            field.light(light.lights(self.places[0]))
        seen = field.forward(self.rays, at)
        color = seen.color
        if isinstance(light, Appearance):
            color = light.forward(seen.color, seen.opacity, self.places[0])
        comparison = Comparison(
            self.background, self.behind.values, self._bend(), field.gradient_scale, self.seed,
            at, isinstance(light, Appearance),
        )  # fmt: skip
        gradients = self.gradients.color, self.gradients.opacity, self.d_behind
        if self.passing is None:
            rt.radiance.training.losses.loss(
                color, seen.opacity, self.targets, self.active, comparison, self.errors, *gradients
            )
        else:
            self.passing.loss(
                (color, seen.opacity), self.targets, self.places, self.active, comparison,
                self.errors, gradients,
            )  # fmt: skip
        if self.distractors is not None:
            self.distractors.weigh(self.errors, self.places, self.active, gradients)
        if self.masks is not None:
            field.leave_out(self.masks, self.errors, gradients)
        if isinstance(light, Appearance):
            light.backward(self.active, self.gradients.color, self.gradients.opacity)
        field.backward(self.gradients)
        if isinstance(light, Embedding) and not self.settled:
            light.backward(field, self.places[0], self.active)
        if self.background == Background.LEARNT:
            rt.radiance.training.background.gather(
                self.d_behind, self.active, self.parts, self.behind.gradients
            )

    def _bend(self) -> float:
        """Return the error of a channel above which the loss grows linearly, or 0."""
        learnt = isinstance(self.appearance, Appearance) and not self.settled
        return GLOSS if learnt and self.field.can_look_aside else self.huber

    def collected(self) -> list[Any]:
        """Return the arrays of gradients that :meth:`compare` fills for :meth:`learn`."""
        beside = None if self.settled else self.appearance, self.passing
        arrays = [one.table.gradients for one in beside if one is not None]
        return [*self.field.collected(), *arrays, self.behind.gradients]

    def learn(self) -> None:
        """Update the parameters by their gradients."""
        learning, scale = self.learning, self.learning.scale / self.field.gradient_scale
        adam, at = self.rt.radiance.training.adam, learning.step
        if self.passing is not None:
            self.passing.learn(learning, scale)
        if self.appearance is not None and not self.settled:
            self.appearance.learn(learning, scale)
        self.field.learn(learning)
        if self.background == Background.LEARNT:
            adam.learning_rate(at, learning.progress, BACKGROUND_RATE, 1, 0.1, *BETAS, self.rate)
            self.clip.update(scale)
            rule = AdamRule(*BETAS, EPSILON)
            adam.adam(self.rate, self.clip.factor, rule, *self.behind.flat())
        adam.advance(at)

    def repeat(self) -> None:
        """Take a step on all devices."""
        if not self.others:
            self._replay(self.step)
            return
        for one in self.team:
            one._replay(one.compare)
        self.add([one.collected() for one in self.team])
        for one in self.team:
            one._replay(one.learn)

    def _replay(self, part: Callable[[], None]) -> None:
        """Run a part of a step, and record it if the field's arrays are new, for later steps."""
        if self._edition != self.field.edition:
            self._edition, self._parts = self.field.edition, {}
        recorded = self._parts.get(part.__name__)
        if recorded is None:
            part()
            self._parts[part.__name__] = self.rt.record(part)
        else:
            recorded()

    def train(
        self,
        seconds: float | None,
        steps: int | None,
        stop: threading.Event,
        say: Say,
        checkpoint: str | os.PathLike[str] | None,
        save_every: float,
        evaluate_every: int | None,
        watch: Watch | None = None,
    ) -> None:
        """Take steps until the budget is spent, `stop` is set or `watch` says so; save the model.

        `watch` is told every LOOK steps, after held-out views were looked at, and at the end.
        """
        state, at = self.model.training, self.learning.step
        state.stopped, first = False, state.step
        self.model.extra.pop(APPEARANCE + "gauge", None)
        before, begin, saved, quality = state.seconds, time.perf_counter(), state.seconds, math.nan
        told, rate = (before, state.total_rays), math.nan

        def spent() -> float:
            return before + time.perf_counter() - begin

        def look_at_clock(step: int) -> None:
            state.progress = min(1.0, step / steps if steps else spent() / (seconds or 1))
            for one in self.team:
                one.rt.write(one.learning.progress, np.array([state.progress], np.float32))

        look_at_clock(state.step // LOOK * LOOK)  # a resumed run may have a different budget
        while (state.step < steps if steps else spent() < (seconds or 0)) and not stop.is_set():
            for one in self.team:
                one.tend(state.step, state.step == first, state.progress)
            self.repeat()
            state.step += 1
            state.total_rays += sum(one.model.training.rays for one in self.team)
            if state.step == first + 1:
                self.rt.to_numpy(at)
                begin = time.perf_counter()  # the first step compiles kernels, so do not count it
                say(state.progress, "Training")
            looks = state.step % LOOK == 0
            # On slow machines LOOK steps take much of the time. Writing waits for a GPU.
            if seconds and spent() / seconds - state.progress > CLOCK:
                look_at_clock(state.step)
            evaluates = evaluate_every is not None and state.step % evaluate_every == 0
            if looks or evaluates:
                quality = self.quality()
            if looks:
                state.total_samples += LOOK * sum(one.fill() for one in self.team)
                look_at_clock(state.step)
                since, told = told, (spent(), state.total_rays)
                rate = (told[1] - since[1]) / max(told[0] - since[0], 1e-9)
                say(state.progress, f"{quality:.1f} dB  {rate / 1e3:,.0f} k rays/s")
            file = checkpoint if looks and spent() - saved >= save_every else None
            watched = watch is not None and (looks or evaluates)
            if evaluates or watched or file is not None:
                self.rt.to_numpy(at)  # wait, so that the time of all launched steps is counted
                state.seconds, paused = spent(), time.perf_counter()
                if evaluates:
                    self.mark(quality, stop, say, FEW)
                if file is not None:
                    self.keep()
                    self.model.save(file)
                    saved = state.seconds
                if watch is not None and watched and watch(self.look(quality, rate)):
                    stop.set()
                begin += time.perf_counter() - paused
        self.rt.to_numpy(at)
        state.seconds, state.stopped = spent(), stop.is_set()
        if seconds:
            state.progress = min(1.0, state.seconds / seconds)
        for one in self.team:
            one._parts, one._edition = {}, -1  # Break the reference cycle.
            one.field.rest()
            one.field.look_aside(False)
        try:
            if not state.stopped and isinstance(self.appearance, Appearance):
                self.keep()
                fit_gauge(self.model, self.scene)
            if not state.stopped and (state.step > first or not state.marks):
                self.mark(quality, stop, say, len(self.scene))
            if watch is not None and state.step > first:
                watch(self.look(self.quality(), rate))
        finally:  # an interrupt while held-out views are rendered must not lose the training
            self.keep()
            if checkpoint is not None:
                self.model.save(checkpoint)

    def tend(self, step: int, first: bool, progress: float) -> None:
        """Do the periodic work before a step, which may be the `first` one of a run."""
        if self.appearance is not None and (step % LOOK == 0 or first):
            aside = progress < SAME
            self.field.look_aside(aside)
            self.settled = self.field.can_look_aside and not aside
        self.field.tend(step, self.learning)
        if self.distractors is not None:
            self.distractors.tend(step)

    def fill(self) -> int:
        """Choose how many rays fill a batch; return how many samples the last one took."""
        samples = self.field.taken()
        rays = self.model.training.rays = self.field.rays_for(samples, self.kept())
        self.rt.write(self.active, np.array([rays], np.int32))
        return samples

    def look(self, quality: float, rate: float) -> Look:
        """Return the state of the training, and make the model ready to render."""
        self.keep()
        state = self.model.training
        mark = state.marks[-1] if state.marks and state.marks[-1].step == state.step else None
        scores = (math.nan, math.nan) if mark is None else (mark.test_psnr, mark.test_ssim)
        loss = 10 ** (-quality / 10)
        return Look(state.step, state.seconds, loss, quality, rate, *scores)

    def quality(self) -> float:
        """Return the signal-to-noise ratio of the last batch, decibels; NaN without rays."""
        errors = self.rt.to_numpy(self.errors)[: self.kept()]
        errors = errors[errors >= 0]  # pixels that were left out have negative ones
        return -10 * math.log10(max(float(errors.mean()), 1e-12)) if errors.size else math.nan

    def kept(self) -> int:
        """Return the number of rays of a batch: the field may lower it until the next check."""
        return int(self.rt.to_numpy(self.active)[0])

    def mark(self, quality: float, stop: threading.Event, say: Say, most: int) -> None:
        """Record the quality on at most `most` held-out views, unless stopped."""
        self.keep()
        state, views = self.model.training, np.flatnonzero(self.scene.test)
        views = views[:: max(1, -(-len(views) // most))]
        scores = []
        for done, view in enumerate(views.tolist()):
            say(state.progress, f"Held-out view {done + 1} of {len(views)}")
            scores.append(evaluate(self.model, self.scene, views=[view]))
            if stop.is_set():
                return
        found = np.mean(scores, axis=(0, 2)).tolist() if scores else [math.nan, math.nan]
        if state.marks and state.marks[-1].step == state.step:
            state.marks.pop()  # replace a mark of fewer views, or of an earlier end of the budget
        state.marks.append(Mark(state.step, state.seconds, quality, *found))

    def keep(self) -> None:
        """Copy the model's data other than the field from the device."""
        self.model.training.rays = self.kept()
        if self.appearance is not None:
            self.model.extra |= self.appearance.state()
        if self.distractors is not None:
            self.model.extra |= self.distractors.state()
        if self.passing is not None:
            self.model.extra |= self.passing.state()
        if self.background == Background.LEARNT:
            self.model.extra |= self.behind.state("behind.", self.rt)
            self.model.behind = self.model.extra["behind.values"].clip(0, 1)
