"""Rendering of parallel planes of 8 bits, none of them with empty parts."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import shift

from cvkern.radiance import cameras, planes_from_depth, render
from cvkern.radiance.fields.planes import PlaneStack
from cvkern.radiance.models import Model
from profiling.case import Case, Peer, Shape, Work

PLANES, ASIDE = 32, (0.011, -0.007)  # the view is moved by this, right and down, in units of depth
# A sample's place is rounded to 1 / 512 of a texel along two axes; neighbours differ by all of the
# range. Then come the samples in front, whose opacities have the same errors.
ROUNDED = 0.01


def _texels(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Make premultiplied texels of 8 bits through which 1 % of the light gets, (D, H, W, 4)."""
    opacity = rng.integers(20, 48, (PLANES, *shape, 1))
    color = rng.integers(0, 256, (PLANES, *shape, 3)) * opacity // 255
    return np.concatenate((color, opacity), axis=-1).astype(np.uint8)


@lru_cache(maxsize=1)
def _made(shape: Shape) -> Model:
    height, width = shape
    K = [[width, 0, (width - 1) / 2], [0, width, (height - 1) / 2], [0, 0, 1]]
    depth = np.broadcast_to(np.linspace(1, 10, width), shape)
    return planes_from_depth(np.zeros((*shape, 3), np.uint8), depth, K, planes=PLANES)


def _view(texels: np.ndarray) -> Model:
    """Return a model of the texels; they are copied only if they are others than before."""
    model = _made(texels.shape[1:3])
    assert isinstance(model.field, PlaneStack)
    if getattr(model, "painted", None) is not texels:
        model.field.paint(model.field.reference, texels)
        model.painted = texels  # pyright: ignore[reportAttributeAccessIssue]
    return model


def _render(texels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    model = _view(texels)
    pose = np.column_stack((np.eye(3), [*ASIDE, 0.0]))
    views = model.cameras
    moved = cameras(pose[None], views.intrinsics, views.width, views.height)
    return render(model, moved)[:2]


def _shifts(shape: Shape) -> list[tuple[float, float]]:
    """Return how far each plane moves, down and to the right, pixels."""
    model = _made(shape)
    assert isinstance(model.field, PlaneStack)
    inverse = model.field.reference.disparities / model.frame.bounds.half
    return [(-ASIDE[1] * shape[1] * q, -ASIDE[0] * shape[1] * q) for q in inverse.tolist()]


def _over(texels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Composite shifted planes from the back, in float64: a translation shifts them."""
    found = np.zeros((*texels.shape[1:3], 4))
    for plane, (down, right) in reversed(
        list(zip(texels, _shifts(texels.shape[1:3]), strict=True))
    ):
        moved = shift(plane / 255.0, (down, right, 0), order=1)
        found = moved + (1 - moved[..., 3:]) * found
    return found[..., :3], found[..., 3]


def _of_opencv(cv2: Any, texels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Do the same with cv2.warpAffine, and OpenCV's arithmetic in float32."""
    size = texels.shape[2], texels.shape[1]
    found = np.zeros((*texels.shape[1:3], 4), np.float32)
    for plane, (down, right) in reversed(
        list(zip(texels, _shifts(texels.shape[1:3]), strict=True))
    ):
        matrix = np.array([[1, 0, right], [0, 1, down]])
        moved = cv2.warpAffine(plane, matrix, size, flags=cv2.INTER_LINEAR)
        moved = cv2.multiply(moved, (1 / 255,) * 4, dtype=cv2.CV_32F)
        left = cv2.subtract((1.0,) * 4, cv2.merge([moved[..., 3]] * 4))
        cv2.add(moved, cv2.multiply(left, found), found)
    return found[..., :3], found[..., 3]


def _apart(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    inner = np.s_[64:-64, 64:-64] if min(right[1].shape) > 256 else np.s_[16:-16, 16:-16]
    return max(
        float(np.abs(a[inner] - b[inner]).max()) for a, b in zip(ours[:2], right[:2], strict=True)
    )


CASES = (
    Case(
        name="render_planes",
        title="A view of 32 planes, none empty, RGBA of 8 bits",
        image=_texels,
        call=_render,
        oracle=_over,
        oracle_name="SciPy in float64",
        difference=_apart,
        tolerance=ROUNDED,
        bytes_per_pixel=4 * PLANES + 20,
        operations_per_pixel=40 * PLANES,
        peers=(Peer("OpenCV", "cv2", _of_opencv, note="places to 1/32 of a pixel"),),
        captures=False,  # a model is no array
        work=Work("samples", lambda texels: texels.size / 4),
        sizes=("VGA",),
        most_inputs=1,
        margin=0,
    ),
)
