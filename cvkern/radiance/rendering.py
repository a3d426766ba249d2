"""Pictures of radiance fields: single views, films, and comparison with photographs."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    as_items,
    as_numbers,
    check_flag,
    check_instance,
    check_integer,
    check_positive,
)
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import LIGHT, CameraSet, Lights
from cvkern.radiance.fields.field import Field, Frame, View
from cvkern.radiance.metrics import psnr, ssim
from cvkern.radiance.models import Model
from cvkern.radiance.pinhole import MOST_SIDE, Cameras, cameras, look_at
from cvkern.radiance.scenes.photographs import Scene, focus_of
from cvkern.radiance.wild.embeddings import light_of

__all__ = ["Picture", "Scores", "evaluate", "orbit_cameras", "render", "render_path"]

SOLID = 0.5  # smallest opacity of a ray that has a depth
RAYS = 2**20  # most rays rendered at a time, in whole rows, which bounds the memory


class Picture(NamedTuple):
    """A view of a field."""

    color: np.ndarray
    """Colour over the background, in [0, 1], (H, W, 3) float32."""
    opacity: np.ndarray
    """Share of the light that the field stops, (H, W) float32."""
    depth: np.ndarray
    """Mean distance along the ray, weighted by the light stopped there, in units of the world,
    (H, W) float32; NaN where the opacity is below one half."""


class Scores(NamedTuple):
    """Measures of how close renderings are to photographs."""

    psnr: np.ndarray
    """Peak signal-to-noise ratio of each view in decibels, (V,) float64."""
    ssim: np.ndarray
    """Structural similarity of each view, (V,) float64; NaN for images that are too small."""


def render(
    model: Model,
    cameras: Cameras,
    view: int = 0,
    *,
    background: Any = None,
    appearance: Any = None,
) -> Picture:
    """Render a view of a model.

    Parameters
    ----------
    model : Model
    cameras : Cameras
        Cameras in the world of the photographs; those of the photographs are ``model.cameras``.
    view : int, default 0
        Index of the camera.
    background : (red, green, blue), optional
        In [0, 1]; by default ``model.behind``.
    appearance : int, or array of shape (3, 4) or (16,), optional
        The light: that of a photograph, by its number among ``model.cameras``, or a matrix (A, b)
        that maps colours c to A c + b, such as one of ``model.appearances``, a mean of two, or the
        result of :func:`fit_appearance`; 16 numbers instead if the model was trained with
        ``appearance="embedding"``. By default the light of the photograph ``model.gauge``.

    Returns
    -------
    Picture

    Raises
    ------
    TypeError
        If `view` is not an integer, or the background or `appearance` does not hold numbers.
    ValueError
        If there is no such view, the background is not three numbers in [0, 1], `appearance` is
        neither a photograph nor finite numbers of the model's shape, or the camera is more than
        32768 half-sides of the scene's cube from its middle.

    Examples
    --------
    >>> from cvkern.radiance import HashField, fit, make_scene, render
    >>> scene = make_scene(train=3, test=1, size=16)
    >>> small = HashField(levels=8, table_bits=10, samples=2**12, rays=64, cells=32)
    >>> model = fit(scene, small, steps=2)
    >>> render(model, scene.cameras, view=3).color.shape
    (16, 16, 3)
    """
    check_instance(model, Model, "model")
    check_instance(cameras, Cameras, "cameras")
    view = check_integer(view, "view", 0, len(cameras) - 1)
    behind = model.behind if background is None else check_behind(background)
    return Renderer(model.field, model.rt)(cameras, view, behind, light_of(model, appearance))


class Renderer:
    """A renderer of the views of a field."""

    def __init__(self, field: Field, rt: Runtime):
        self.field, self.rt = field, rt

    def __call__(
        self, cameras: Cameras, view: int, behind: np.ndarray, light: np.ndarray | None = None
    ) -> Picture:
        """Render a view in a light of :func:`light_of`."""
        rt, frame, width = self.rt, self.field.frame, cameras.width
        lens = on_device(rt, frame, cameras.select([view]))
        count = cameras.height * width
        pictures = [rt.empty((cameras.height, width, *tail)) for tail in ((3,), (), ())]
        flat = (count, 3), (count,), (count,)
        seen = View(*(rt.adopt(p, shape=s) for p, s in zip(pictures, flat, strict=True)))
        if self.field.whole:
            self._show(lambda: self.field.draw(lens, seen), seen, light)
            count = 0  # no rays are left
        most = max(RAYS // width, 1) * width
        for begin in range(0, count, most):
            part = slice(begin, min(begin + most, count))
            shape = part.stop - begin, 3
            origins, directions = (rt.scratch(f"view.{n}", shape) for n in ("from", "towards"))
            rt.radiance.pinhole.view_rays(lens, 0, begin, origins, directions)
            self.look(origins, directions, View(*(a[part] for a in seen)), light, width)
        red, green, blue = map(float, behind)
        rt.radiance.rendering.finish(red, green, blue, frame.bounds.half, SOLID, *seen)
        return Picture(*(rt.release(p) for p in pictures))

    def look(
        self,
        origins: Any,
        directions: Any,
        seen: View,
        light: np.ndarray | None = None,
        row: int = 0,
    ) -> None:
        """Fill `seen` for rays, as :meth:`Field.see` does, in a light of :func:`light_of`."""
        self._show(lambda: self.field.see(origins, directions, seen, row), seen, light)

    def _show(self, show: Callable[[], None], seen: View, light: np.ndarray | None) -> None:
        """Fill `seen` by `show`, in a light of :func:`light_of`."""
        if light is None:
            show()
            return
        rt, count = self.rt, seen.opacity.shape[0]
        views, table = rt.scratch("view.light", (count,), np.int32), rt.send("view.table", light)
        rt.clear(views)
        if light.shape[1] == LIGHT:
            self.field.light(Lights(table, views))
        show()
        if light.shape[1] != LIGHT:
            rt.radiance.wild.appearance.apply(seen.color, seen.opacity, views, table, seen.color)


def render_path(
    model: Model,
    cameras: Cameras,
    path: str | os.PathLike[str],
    *,
    fps: float = 20.0,
    background: Any = None,
    appearance: Any = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Render views in sequence as a film.

    Parameters
    ----------
    model : Model
    cameras : Cameras
        One view for each frame, for example those of :func:`orbit_cameras`.
    path : path
        Ends in ``.gif``, or in ``.mp4``, which needs an even height and width and imageio-ffmpeg.
    fps : float, default 20.0
        Frames per second, > 0; for ``.gif`` at most 50.
    background : (red, green, blue), optional
        In [0, 1]; by default ``model.behind``.
    appearance : int, or array of shape (3, 4), (16,), (F, 3, 4) or (F, 16), optional
        The light, as in :func:`render`, or one for each frame.
    progress : function, optional
        Called with the number of frames done and the number of all frames.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    ModuleNotFoundError
        If `path` ends in ``.mp4`` and imageio-ffmpeg is not installed.
    TypeError
        If `fps` is not a number, or the background or `appearance` does not hold numbers.
    ValueError
        If `path` ends otherwise, height and width do not suit it, an option is out
        of its range, or a camera is more than 32768 half-sides of the scene's cube from its middle.
    """
    check_instance(model, Model, "model")
    check_instance(cameras, Cameras, "cameras")
    from cvkern.clouds.films import check_animation, write_animation

    check_animation(path, (len(cameras), cameras.height, cameras.width, 3), fps)
    frames = film(model, cameras, background=background, appearance=appearance, progress=progress)
    write_animation(path, frames, fps=fps)


def film(
    model: Model,
    cameras: Cameras,
    *,
    background: Any = None,
    appearance: Any = None,
    progress: Callable[[int, int], None] | None = None,
) -> np.ndarray:
    """Return the views of `cameras`, (F, H, W, 3) uint8; see :func:`render_path`."""
    behind = model.behind if background is None else check_behind(background)
    model.frame.inside(cameras.poses)  # refuses distant cameras before the work
    each = np.ndim(appearance) == model.appearances.ndim
    if each and len(appearance) != len(cameras):
        raise ValueError(
            f"appearance must have one light for each of {len(cameras)} frames, got "
            f"{len(appearance)}"
        )
    lights = [light_of(model, a) for a in (appearance if each else [appearance])]
    draw = Renderer(model.field, model.rt)
    frames = np.empty((len(cameras), cameras.height, cameras.width, 3), np.uint8)
    for i in range(len(cameras)):
        frames[i] = np.round(255 * draw(cameras, i, behind, lights[i if each else 0]).color)
        if progress:
            progress(i + 1, len(cameras))
    return frames


def orbit_cameras(views: Cameras, frames: int = 60, *, factor: float = 1.0) -> Cameras:
    """Return cameras on a closed path around the point that the given cameras look at.

    Parameters
    ----------
    views : Cameras
        The cameras of the photographs, as in ``scene.cameras`` or ``model.cameras``.
    frames : int, default 60
        Number of cameras; they make a loop.
    factor : float, default 1.0
        Size of the images divided by the size of the photographs, > 0.

    Returns
    -------
    Cameras
        Cameras at the mean height and distance of the given ones, with their mean upward direction,
        and with the lens of the first one without its distortion. If the given cameras cover less
        than half a circle, the path swings back and forth within their range.

    Raises
    ------
    TypeError
        If `frames` is not an integer, or `factor` is not a number.
    ValueError
        If either is out of its range.
    """
    check_instance(views, Cameras, "views")
    count = check_integer(frames, "frames", 1, 2**12)
    sized = views.scaled(check_positive(factor, "factor"))
    if max(sized.width, sized.height) > MOST_SIDE:
        sides = f"{sized.height} x {sized.width}"
        raise ValueError(f"factor must give at most {MOST_SIDE} pixels a side, got {sides}")
    poses = views.poses
    middle = focus_of(poses)
    up = -poses[:, :, 1].mean(axis=0)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0.1 else np.array([0.0, 0.0, 1.0])
    arms = poses[:, :, 3] - middle
    height = arms @ up
    flat = arms - height[:, None] * up
    reach = np.linalg.norm(flat, axis=1)
    # Angles around `up`, measured from the first of two axes normal to it.
    east = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    angles = np.sort(np.arctan2(flat @ north, flat @ east))
    gaps = np.diff(angles, append=angles[0] + 2 * math.pi)
    widest = int(gaps.argmax())
    turn = np.arange(count) / count
    if gaps[widest] < math.pi:
        path = angles[0] + 2 * math.pi * turn
    else:
        begin = angles[(widest + 1) % len(angles)]
        spread = 2 * math.pi - gaps[widest]
        path = begin + spread * (0.5 - 0.5 * np.cos(2 * math.pi * turn))
    around = np.cos(path)[:, None] * east + np.sin(path)[:, None] * north
    radius = max(float(reach.mean()), 1e-6 * (1 + float(np.abs(height).max())))
    eyes = middle + height.mean() * up + radius * around
    poses = look_at(eyes, middle, up)
    return cameras(poses, sized.intrinsics[0], sized.width, sized.height)


def evaluate(
    model: Model,
    scene: Scene,
    *,
    test: bool = True,
    views: Sequence[int] | np.ndarray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Scores:
    """Compare a model with the photographs of a scene.

    Parameters
    ----------
    model : Model
    scene : Scene
    test : bool, default True
        Compare with the held-out views if True, else with the others.
    views : sequence of int, optional
        Compare with these views instead.
    progress : function, optional
        Called with the number of views done and the number of all views.

    Returns
    -------
    Scores
        One value per view. Photographs with opacity are composited over ``model.behind``, as the
        renderings are. Pixels that a mask of the scene leaves out do not count in the signal-to-
        noise ratio, and are taken as equal in the structural similarity.

    Raises
    ------
    TypeError
        If a view is not an integer.
    ValueError
        If there is no such view, or its camera is more than 32768 half-sides of the scene's cube
        from its middle.
    """
    test = check_flag(test, "test")
    check_instance(model, Model, "model")
    check_instance(scene, Scene, "scene")
    if views is None:
        views = np.flatnonzero(scene.test == test)
    given = as_items(views, "views", "a sequence of integers")
    chosen = [check_integer(v, "views", 0, len(scene) - 1) for v in given]
    if not chosen:
        kind = "held out" if test else "to train from"
        raise ValueError(f"scene must have views {kind}, got {len(scene)} others")
    model.frame.inside(scene.cameras.poses[chosen])  # refuses distant cameras before the work
    draw = Renderer(model.field, model.rt)
    light = light_of(model, None)
    scores = np.full((2, len(chosen)), np.nan)
    for i, view in enumerate(chosen):
        found = draw(scene.cameras, view, model.behind, light).color
        wanted = photograph(scene, view, model.behind)
        if scene.masks is None:
            scores[0, i] = psnr(found, wanted)
        elif scene.masks[view].any():
            seen = scene.masks[view]
            scores[0, i] = psnr(found[seen][None], wanted[seen][None])
            found = np.where(seen[..., None], found, wanted)
        if min(found.shape[:2]) >= 11:
            scores[1, i] = ssim(found, wanted)
        if progress:
            progress(i + 1, len(chosen))
    return Scores(*scores)


def photograph(scene: Scene, view: int, behind: np.ndarray) -> np.ndarray:
    """Return a photograph over a background, (H, W, 3) float32 in [0, 1]."""
    image = scene.images[view].astype(np.float32) / 255
    if image.shape[2] == 3:
        return image
    seen = image[..., 3:]
    return image[..., :3] * seen + (1 - seen) * behind


def on_device(rt: Runtime, frame: Frame, views: Cameras) -> CameraSet:
    """Return cameras in the coordinates of the frame, as kernels take them."""
    lenses = np.hstack((views.intrinsics, views.distortion)).astype(np.float32)
    poses = owned(rt, frame.inside(views.poses))
    return CameraSet(poses, owned(rt, lenses), views.width, views.height)


def owned(rt: Runtime, values: np.ndarray) -> Any:
    """Return a new kernel array with these values."""
    array = rt.zeros(values.shape, values.dtype)
    rt.write(array, np.ascontiguousarray(values))
    return array


def check_behind(background: Any) -> np.ndarray:
    """Return a checked colour, (3,) float32."""
    color = as_numbers(background, "background", np.float32)
    if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
        raise ValueError(f"background must be three numbers in [0, 1], got {background!r}")
    return color
