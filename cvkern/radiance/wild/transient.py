"""What passes in front of photographs, learnt with the field: the transient head of NeRF-W."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_instance, check_integer
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import AdamRule, Comparison, Head, WildGradients
from cvkern.radiance.fields.hash import BETAS, EPSILON
from cvkern.radiance.models import TRANSIENT, Model, nodes_of
from cvkern.radiance.wild.tables import Table

__all__ = ["Transient", "render_transient"]

LEAST = 0.1  # standard deviation of colours where nothing passes
PENALTY = 0.3  # weight of the density in the loss
DELAY = 100  # steps before which nothing passes, so that the scene is there first
RATE, WARMUP, FINAL = 0.2, 20, 0.1  # learning rate, steps until it is full, share at the end
START = -3.0, 0.0, 0.0, 0.0, -2.0  # a density of 0.05, grey, and a doubt of 0.13


class Transient(NamedTuple):
    """What a model takes for passing in front of a photograph."""

    color: np.ndarray
    """(H, W, 3) float32."""
    opacity: np.ndarray
    """(H, W) float32."""
    doubt: np.ndarray
    """Standard deviation of its colours, in addition to that of the scene's, (H, W) float32."""


class Passing(Table):
    """The heads of the training photographs, being learnt."""

    prefix, rates = TRANSIENT, (RATE, WARMUP, FINAL)
    rule = AdamRule(*BETAS, EPSILON, sparse=True)

    def __init__(self, rt: Runtime, shape: tuple[int, ...], rays: int, exact: bool):
        """Begin for photographs of the shape (N, H, W); gradients are integers if `exact`."""
        images, height, width = shape
        side, rows, columns = nodes_of(height, width)
        super().__init__(rt, np.broadcast_to(START, (images, rows, columns, 5)))
        if exact:
            self.table.make_deterministic(rt)
        self.head = Head(self.table.values, width, side, LEAST, PENALTY, DELAY)
        self._d_head = rt.zeros((rays, 5))

    def loss(
        self,
        seen: tuple[Any, Any],
        targets: Any,
        places: tuple[Any, Any],
        active: Any,
        comparison: Comparison,
        errors: Any,
        gradients: tuple[Any, Any, Any],
    ) -> None:
        """Fill the errors, and the gradients by colours, opacities and backgrounds."""
        kernels = self.rt.radiance.wild.transient
        kernels.loss(
            *seen, targets, *places, active, comparison, self.head, errors,
            WildGradients(*gradients, self._d_head),
        )  # fmt: skip
        kernels.backward(self._d_head, *places, active, self.head, self.table.sums)
        self.table.collect(self.rt)


def render_transient(model: Model, view: int) -> Transient:
    """Show what passes in front of a photograph that a model was trained on.

    Parameters
    ----------
    model : Model
        Trained with ``transient=True``.
    view : int
        The number of the photograph, among ``model.cameras``.

    Returns
    -------
    Transient
        In the size of the photograph. Nothing, black, for photographs that were not trained on.

    Raises
    ------
    TypeError
        If `view` is not an integer.
    ValueError
        If there is no such photograph, or the model was trained without ``transient=True``.

    Examples
    --------
    >>> from cvkern.radiance import VoxelField, fit, make_scene, render_transient
    >>> scene = make_scene(train=3, test=1, size=16)
    >>> field = VoxelField(resolutions=(16,), shares=(), rays=64)
    >>> model = fit(scene, field, steps=2, transient=True)
    >>> render_transient(model, 0).opacity.shape
    (16, 16)
    """
    check_instance(model, Model, "model")
    view = check_integer(view, "view", 0, len(model.cameras) - 1)
    if not model.transient:
        raise ValueError("model must be trained with transient=True, got one without")
    height, width = model.cameras.height, model.cameras.width
    found = np.flatnonzero(model.extra[TRANSIENT + "views"] == view)
    if not len(found):
        empty = np.zeros((height, width), np.float32)
        return Transient(np.zeros((height, width, 3), np.float32), empty, empty.copy())
    nodes, (side, _, _) = model.extra[TRANSIENT + "values"][found[0]], nodes_of(height, width)
    for axis, count in enumerate((height, width)):
        at = np.arange(count)
        low, share = at // side, (at % side / side).astype(np.float32)
        share = share.reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        nodes = nodes.take(low, axis) * (1 - share) + nodes.take(low + 1, axis) * share
    density, doubt = (np.logaddexp(0, nodes[..., k]) for k in (0, 4))
    return Transient(1 / (1 + np.exp(-nodes[..., 1:4])), -np.expm1(-density), doubt)
