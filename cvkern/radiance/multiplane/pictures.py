"""Multiplane images of one photograph with depths, or of a rectified pair, without training."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import as_array, as_numbers, check_integer, check_number, check_positive
from cvkern._runtime import refuse_capture, runtime
from cvkern.radiance.fields.field import FARTHEST, Frame
from cvkern.radiance.fields.planes import (
    LEAST,
    MOST,
    MOST_PLANES,
    PlanesField,
    PlaneStack,
    Reference,
)
from cvkern.radiance.models import Model, Training
from cvkern.radiance.multiplane.layering import extend, opacities
from cvkern.radiance.pinhole import cameras
from cvkern.radiance.scenes.photographs import Bounds

__all__ = ["planes_from_depth", "planes_from_stereo"]

TAILS = 0.1, 99.9  # percentiles of the inverse depths between which the planes are
BEHIND = 0.08  # share of the longer side by which planes go on behind nearer surfaces
REMOTE = 1e30  # depths from there on are far away; those below 1 / REMOTE are unknown too
SAME = 1e-3  # least range of inverse depths, as a share of the largest


def planes_from_depth(
    image: Any,
    depth: Any,
    K: Any,
    *,
    planes: int = 32,
    near: float | None = None,
    far: float | None = None,
    reach: int | None = None,
) -> Model:
    """Make a multiplane image of a photograph whose depths are known.

    Each pixel is shared between the two planes around its depth. Surfaces go on behind nearer ones
    with the colours of their edges, so that a view from aside shows no holes.

    Parameters
    ----------
    image : array of shape (H, W, 3), uint8
        The photograph, at least 2 x 2 pixels.
    depth : array of shape (H, W)
        Distance of each pixel from the camera along its axis, > 0, as :func:`disparity_to_depth`
        returns it. Infinite, NaN and 0 mean far away, as does what is beyond 1e-30 to 1e30.
    K : array of shape (3, 3)
        Camera matrix of the photograph, ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``; no distortion.
    planes : int, default 32
        Number of planes, at most 512; they are evenly spaced in 1 / depth.
    near, far : float, optional
        Depths of the first and the last plane; by default those of the nearest and the farthest
        pixels but one in a thousand. Other pixels are moved there.
    reach : int, optional
        Pixels by which a surface goes on behind a nearer one; by default 8 % of the longer side.

    Returns
    -------
    Model
        A model of a :class:`PlanesField` for :func:`render`, in the camera's axes, with texels of
        8 bits. Its camera is ``model.cameras``; it cannot be trained.

    Raises
    ------
    TypeError
        If `image` is not uint8, or an argument does not hold numbers.
    ValueError
        If a shape does not match, no depth is known, a depth is negative, `K` is no camera matrix,
        or an option is out of its range.

    References
    ----------
    .. [1] R. Szeliski and P. Golland, "Stereo matching with transparency and matting",
       International Journal of Computer Vision 32(1), 1999.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.radiance import planes_from_depth, render
    >>> image = np.full((8, 9, 3), 128, np.uint8)
    >>> K = [[9, 0, 4], [0, 9, 3.5], [0, 0, 1]]
    >>> model = planes_from_depth(image, np.full((8, 9), 2.0), K, planes=2)
    >>> render(model, model.cameras).color[4, 4].round(3)
    array([0.502, 0.502, 0.502], dtype=float32)
    """
    refuse_capture("planes_from_depth")
    photo = _photograph(image, "image")
    found = as_numbers(depth, "depth")
    if found.shape != photo.shape[:2]:
        raise ValueError(f"depth must have shape {photo.shape[:2]}, got {found.shape}")
    if (found < 0).any():
        raise ValueError(f"depth must not be negative, got {np.nanmin(found):g}")
    known = (found > 1 / REMOTE) & (found < REMOTE)
    if not known.any():
        raise ValueError("depth must be finite and > 0 somewhere, got none")
    inverse = np.where(known, 1 / np.where(known, found, 1.0), 0.0)
    return _layered(photo, inverse, known, K, planes, (near, far), reach)


def planes_from_stereo(
    left: Any,
    right: Any,
    K: Any,
    *,
    disparities: tuple[int, int] = (0, 64),
    baseline: float = 1.0,
    doffs: float = 0.0,
    planes: int = 32,
    reach: int | None = None,
) -> Model:
    """Make a multiplane image of a rectified pair.

    The disparities are those of :func:`stereo_match`; the planes are as of
    :func:`planes_from_depth`.

    Parameters
    ----------
    left, right : array of shape (H, W, 3), uint8
        A rectified pair.
    K : array of shape (3, 3)
        Camera matrix of the left image.
    disparities : (int, int), default (0, 64)
        The first disparity, and the one after the last, pixels.
    baseline : float, default 1.0
        Distance between the cameras, > 0, which sets the unit of length.
    doffs : float, default 0.0
        Column of the right principal point minus that of the left one, pixels.
    planes, reach
        As in :func:`planes_from_depth`.

    Returns
    -------
    Model
        As of :func:`planes_from_depth`, in the axes of the left camera.

    Raises
    ------
    TypeError, ValueError
        As :func:`planes_from_depth` and :func:`stereo_match`; also if no pixel is in front of the
        cameras.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.radiance import planes_from_stereo, render
    >>> left = np.random.default_rng(0).integers(0, 256, (24, 40, 3), np.uint8)
    >>> K = [[40, 0, 19.5], [0, 40, 11.5], [0, 0, 1]]
    >>> model = planes_from_stereo(left, np.roll(left, -4, 1), K, disparities=(0, 8), planes=4)
    >>> render(model, model.cameras).color.shape
    (24, 40, 3)
    """
    from cvkern.stereo import stereo_match

    refuse_capture("planes_from_stereo")
    photos = [_photograph(photo, name) for photo, name in ((left, "left"), (right, "right"))]
    if photos[0].shape != photos[1].shape:
        raise ValueError(f"right must have shape {photos[0].shape}, got {photos[1].shape}")
    matrix = _matrix(K)
    length = check_positive(baseline, "baseline") * matrix[0, 0]
    shift = check_number(doffs, "doffs")
    found = stereo_match(photos[0], photos[1], disparities, channel_axis=-1)
    with np.errstate(over="ignore"):  # such points are too near to be known
        inverse = (found.disparity.astype(np.float64) + shift) / length
    known = (inverse > 1 / REMOTE) & (inverse < REMOTE)
    if not known.any():
        raise ValueError(f"disparities must put pixels in front of the cameras, got {disparities}")
    inverse = np.where(known, inverse, 0.0)
    return _layered(photos[0], inverse, known & found.valid, matrix, planes, (None, None), reach)


def _layered(
    photo: np.ndarray,
    inverse: np.ndarray,
    known: np.ndarray,
    K: Any,
    planes: int,
    span: tuple[float | None, float | None],
    reach: int | None,
) -> Model:
    """Return planes for the inverse depth of each pixel; those that are known decide on the range.

    `span` has the depths of the first and of the last plane, or None.
    """
    near, far = span
    planes = check_integer(planes, "planes", 1, MOST_PLANES)
    settings = PlanesField(planes, near, far, texels=max(2**24, planes * photo[..., 0].size))
    matrix, shape = _matrix(K), photo.shape[:2]
    reach = round(BEHIND * max(shape)) if reach is None else check_integer(reach, "reach", 0, MOST)
    values = inverse[known] if known.any() else inverse[inverse > 0]
    low, high = np.percentile(values, TAILS)
    high = high if near is None else 1 / near
    low = low if far is None else 1 / far
    if not high > low * (1 + SAME):  # one plane, or all at one depth
        low, high = low * (1 - SAME), max(low, high)
    disparities = np.linspace(high, low, planes) if planes > 1 else np.array([np.median(values)])
    places = np.zeros(shape)
    if planes > 1:
        places = ((high - inverse) * ((planes - 1) / (high - low))).clip(0, planes - 1)
    opacity = opacities(places, planes)
    texels = np.zeros((*opacity.shape, 4), np.uint8)
    for k, (to, like) in enumerate(extend(opacity, places, reach)):
        colors, at = photo.copy(), np.nonzero(opacity[k])
        colors[to] = photo[like]
        share = opacity[k][at][:, None]
        texels[k][at] = np.rint(np.hstack((colors[at] * share, 255 * share)))
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    middle = 2 / (high + low)
    frame = Frame(Bounds((0.0, 0.0, float(middle)), float(middle), True), 0.0, 2.0 * FARTHEST,
                  1 / fx)  # fmt: skip
    views = cameras(np.eye(4)[None], [fx, fy, cx, cy], shape[1], shape[0])
    field = PlaneStack(runtime(), frame, settings)
    pose = frame.inside(views.poses)[0].astype(np.float64)
    lens = np.array([fx, fy, cx, cy])
    field.paint(Reference(pose, lens, disparities * middle), texels)
    training = Training(resumable=False)
    return Model(field, settings, "black", np.zeros(3, np.float32), views, 0, training, {})


def _photograph(image: Any, name: str) -> np.ndarray:
    """Return a photograph as NumPy array."""
    photo = np.asarray(as_array(image, name))
    if photo.dtype != np.uint8:
        raise TypeError(f"{name} must be uint8, got {photo.dtype}")
    shape = photo.shape
    if len(shape) != 3 or shape[2] != 3 or not all(LEAST <= n <= MOST for n in shape[:2]):
        raise ValueError(
            f"{name} must have shape (H, W, 3) with {LEAST} to {MOST} rows and columns, got {shape}"
        )
    return photo


def _matrix(K: Any) -> np.ndarray:
    """Return a checked camera matrix."""
    matrix = as_numbers(K, "K")
    good = matrix.shape == (3, 3) and np.isfinite(matrix).all()
    if not good or not (matrix[0, 0] > 0 < matrix[1, 1]) or matrix[2].tolist() != [0, 0, 1]:
        raise ValueError(
            "K must be a camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got "
            f"{matrix.tolist()}"
        )
    return matrix
