"""The light of each photograph as an affine map of its colours, learnt with the field."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import as_array, check_instance
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import LIGHT_PARTS, AdamRule
from cvkern.radiance.fields.field import View
from cvkern.radiance.fields.hash import BETAS, EPSILON
from cvkern.radiance.models import APPEARANCE, Model
from cvkern.radiance.pinhole import Cameras, pixel_rays
from cvkern.radiance.rendering import Renderer, owned, render
from cvkern.radiance.scenes.photographs import Scene
from cvkern.radiance.wild.embeddings import search
from cvkern.radiance.wild.tables import Table

__all__ = ["fit_appearance"]

RATE, WARMUP, FINAL = 1e-2, 100, 0.1  # learning rate, steps until it is full, share at the end
RIDGE = 1e-4  # weight of the identity in the fit of a photograph's map, for each pixel
DECAY = 3e-5  # weight decay towards the identity
PIXELS = 4096  # most pixels of the search for the light of a new photograph
ROUNDS = 4  # A fit leaves out the clipped channels that are beyond the map of the fit before.


class Appearance(Table):
    """The maps of the training photographs, being learnt."""

    prefix, rates = APPEARANCE, (RATE, WARMUP, FINAL)
    rule = AdamRule(*BETAS, EPSILON, DECAY)

    def __init__(self, rt: Runtime, images: int, rays: int):
        super().__init__(rt, np.zeros((images, 12)))
        self.shown = rt.zeros((rays, 3))
        self._parts = rt.zeros((LIGHT_PARTS, images, 12))

    def forward(self, color: Any, opacity: Any, views: Any) -> Any:
        """Return composited colours in the light of their photographs, `views` (R,)."""
        self._seen = color, opacity, views
        self.rt.radiance.wild.appearance.apply(*self._seen, self.table.values, self.shown)
        return self.shown

    def backward(self, active: Any, d_color: Any, d_opacity: Any) -> None:
        """Turn gradients by the colours of :meth:`forward` into those by the composited ones."""
        self.rt.radiance.wild.appearance.backward(
            *self._seen, self.table.values, active, d_color, d_opacity, self._parts,
            self.table.gradients,
        )  # fmt: skip


def fit_appearance(
    model: Model, image: Any, cameras: Cameras, view: int = 0, *, mask: Any = None
) -> np.ndarray:
    """Find the light of a photograph that a model was not trained on.

    Parameters
    ----------
    model : Model
    image : array of shape (H, W, 3) or (H, W, 4), uint8
        The photograph.
    cameras : Cameras
        Its camera is the one of index `view`.
    view : int, default 0
    mask : array of shape (H, W), bool, optional
        The pixels to compare, by default all; for a fair test, half of them.

    Returns
    -------
    array of shape (3, 4) or (16,), float64
        The light, for ``render(..., appearance=light)``. It is the matrix (A, b) of the map A c + b
        of colours: the least squares over the pixels, with a weak preference for the identity. A
        channel of 0 or 255 counts as that value or beyond. For a model that was trained with
        ``appearance="embedding"``, it is the 16 numbers of least squares over at most 4096 of the
        pixels, by Levenberg's and Marquardt's method, with a weak preference for the mean of the
        known lights.

    Raises
    ------
    TypeError
        If `image` is not uint8, or `mask` not bool.
    ValueError
        If a shape does not match, or no pixel is chosen.

    Examples
    --------
    >>> from cvkern.radiance import VoxelField, fit, fit_appearance, make_scene
    >>> scene = make_scene(train=3, test=1, size=16)
    >>> model = fit(scene, VoxelField(resolutions=(16,), shares=(), rays=64), steps=2)
    >>> fit_appearance(model, scene.images[3], scene.cameras, 3).shape
    (3, 4)
    """
    check_instance(model, Model, "model")
    check_instance(cameras, Cameras, "cameras")
    photo = np.asarray(as_array(image, "image"))
    shape = cameras.height, cameras.width
    if photo.dtype != np.uint8:
        raise TypeError(f"image must be uint8, got {photo.dtype}")
    if photo.shape not in ((*shape, 3), (*shape, 4)):
        raise ValueError(f"image must have shape {(*shape, 3)}, got {photo.shape}")
    chosen = np.ones(shape, bool) if mask is None else np.asarray(as_array(mask, "mask"))
    if chosen.dtype != bool:
        raise TypeError(f"mask must be bool, got {chosen.dtype}")
    if chosen.shape != shape:
        raise ValueError(f"mask must have shape {shape}, got {chosen.shape}")
    if not chosen.any():
        raise ValueError("mask must choose a pixel, got none")
    embedded = model.appearance == "embedding"
    few = np.argwhere(chosen)
    if embedded:
        few = few[:: -(-len(few) // PIXELS)]
        chosen = np.zeros(shape, bool)
        chosen[tuple(few.T)] = True
    if not embedded:
        return _fitted(model, photo, cameras, view, chosen.astype(np.float64))
    color, opacity = _composited(photo[chosen])
    return _searched(model, pixel_rays(cameras, view, few), color, opacity)


def fit_gauge(model: Model, scene: Scene) -> None:
    """Find the map of the photograph whose light pictures have again, from all its pixels.

    A training sees few of them while the field still changes. The map is kept beside those that a
    resumed training goes on with.
    """
    view = model.gauge
    weights = model.weights[view].astype(np.float64)
    if scene.masks is not None:
        weights *= scene.masks[view]
    found = _fitted(model, scene.images[view], scene.cameras, view, weights) - np.eye(3, 4)
    model.extra[APPEARANCE + "gauge"] = found.reshape(1, 12).astype(np.float32)


def _composited(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the premultiplied colours (N, 3) and the opacities (N,) of pixels of bytes."""
    wanted = pixels.astype(np.float64) / 255
    if pixels.shape[1] == 4:
        return wanted[:, :3] * wanted[:, 3:], wanted[:, 3]
    return wanted, np.ones(len(wanted))


def _fitted(
    model: Model, photo: np.ndarray, cameras: Cameras, view: int, weights: np.ndarray
) -> np.ndarray:
    """Return the map of least squares over the pixels of weights (H, W) above 0."""
    chosen = weights > 0
    pixels, share = photo[chosen], weights[chosen, None]
    color, opacity = _composited(pixels)
    seen = render(model, cameras, view, background=(0, 0, 0), appearance=np.eye(3, 4))
    found = np.column_stack((seen.color[chosen], seen.opacity[chosen])).astype(np.float64)
    # What the field does not cover is background, in the photograph too.
    wanted = color - (opacity - found[:, 3])[:, None] * model.behind
    least, most = pixels[:, :3] == 0, pixels[:, :3] == 255
    start = light = np.eye(3, 4)
    rest, ridge = wanted - found @ start.T, RIDGE * share.sum() * np.eye(4)
    for _ in range(ROUNDS):
        error = found @ light.T - wanted
        counts = share * ~((most & (error > 0)) | (least & (error < 0)))
        weighed = counts.T[:, None] * found.T  # (3, 4, N)
        system = weighed @ found + ridge
        light = start + np.linalg.solve(system, weighed @ rest.T[..., None])[..., 0]
    return light


def _searched(
    model: Model, rays: tuple[np.ndarray, np.ndarray], color: np.ndarray, opacity: np.ndarray
) -> np.ndarray:
    """Return the numbers of the light in which rays of the world have these colours."""
    rt, bounds, count = model.rt, model.frame.bounds, len(color)
    origins = (rays[0] - np.array(bounds.center)) / bounds.half
    places = owned(rt, origins.astype(np.float32)), owned(rt, rays[1].astype(np.float32))
    seen = View(rt.zeros((count, 3)), rt.zeros((count,)), rt.zeros((count,)))
    draw = Renderer(model.field, rt)

    def errors(light: np.ndarray) -> np.ndarray:
        draw.look(*places, seen, light.astype(np.float32).reshape(1, -1))
        found = rt.to_numpy(seen.color).astype(np.float64)
        left = (opacity - rt.to_numpy(seen.opacity))[:, None] * model.behind
        return (found + left - color).ravel()

    return search(model.appearances[model.extra[APPEARANCE + "views"]], errors)
