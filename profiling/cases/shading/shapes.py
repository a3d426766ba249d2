"""From images to normals, and from normals to depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

import cvkern
from profiling.case import Case, Shape, Work
from profiling.cases.shading.rendering import most_apart

COUNT = 96  # images
NOISE = 0.01


def _lights() -> np.ndarray:
    turns = 2.4 * np.arange(COUNT)  # the golden angle, about
    slants = 0.9 * np.sqrt((np.arange(COUNT) + 0.5) / COUNT)
    vectors = np.stack([slants * np.cos(turns), slants * np.sin(turns), np.ones(COUNT)], axis=1)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _depth(shape: Shape) -> np.ndarray:
    y, x = np.indices(shape) / 16.0
    return 6 * np.sin(x) * np.cos(y)


def _images(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    images = cvkern.lambertian(_depth(shape), _lights())
    return images + rng.normal(0, NOISE, images.shape).astype(np.float32)


def _normals(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    normals = np.asarray(cvkern.normals_from_depth(_depth(shape)))
    return normals + rng.normal(0, NOISE, normals.shape).astype(np.float32)


def _least_squares(images: np.ndarray) -> np.ndarray:
    flat = images.reshape(COUNT, -1).astype(np.float64)
    s = np.linalg.lstsq(_lights(), flat, rcond=None)[0]
    return (s / np.linalg.norm(s, axis=0)).T.reshape(*images.shape[1:], 3)


def _without_curve(slopes: np.ndarray) -> np.ndarray:
    """Return slopes down the rows less a twelfth of their second derivatives."""
    second = slopes[:-2] - 2 * slopes[1:-1] + slopes[2:]
    change = np.concatenate([second[:1], second, second[-1:]])
    change[2:-2] = slopes[:-4] - 3 * (slopes[1:-3] + slopes[3:-1]) + 4 * slopes[2:-2] + slopes[4:]
    return slopes - change / 12


def _factored(normals: np.ndarray) -> np.ndarray:
    """Solve the least squares of all rises by factors of their sparse equations: no transform."""
    n = normals.astype(np.float64)
    p, q = _without_curve((n[..., 0] / n[..., 2]).T).T, _without_curve(-n[..., 1] / n[..., 2])
    rises = np.concatenate([(p[:, 1:] + p[:, :-1]).ravel(), (q[1:] + q[:-1]).ravel()]) / 2
    at, rows = np.arange(p.size).reshape(p.shape), np.arange(rises.size)
    near = np.concatenate([at[:, :-1].ravel(), at[:-1].ravel()])
    far = np.concatenate([at[:, 1:].ravel(), at[1:].ravel()])
    ends = np.concatenate([np.ones(rises.size), -np.ones(rises.size)])
    places = np.tile(rows, 2), np.concatenate([far, near])
    change = coo_array((ends, places), shape=(rises.size, p.size)).tocsc()[:, 1:]  # the first is 0
    factors = splu(
        (change.T @ change).tocsc(), "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True}
    )
    depth = np.concatenate([[0], factors.solve(change.T @ rises)]).reshape(p.shape)
    return depth - depth.mean()


def _stereo(method: str) -> Any:
    lights = _lights()
    return lambda images: cvkern.photometric_stereo(images, lights, method=method).normals


CASES = (
    Case(
        name="photometric_stereo",
        title="Normals from 96 images by least squares, float32",
        image=_images,
        call=_stereo("least_squares"),
        oracle=_least_squares,
        oracle_name="NumPy in float64",
        difference=most_apart,
        tolerance=1e-5,  # 96 products of float32 by an inverse of entries below 0.1
        bytes_per_pixel=4 * COUNT + 1 + 20,
        operations_per_pixel=15 * COUNT,
        work=Work("pixels", lambda images: images.shape[1] * images.shape[2]),
        sizes=("1024x440",),
        most_inputs=2,
        margin=0,
    ),
    Case(
        name="integrate_normals",
        title="Depth from normals in a rectangle, float32",
        image=_normals,
        call=cvkern.integrate_normals,
        oracle=_factored,
        oracle_name="SciPy's factors of the sparse equations",
        difference=most_apart,
        # Pixels. SciPy's transforms on the CPU only round the depth: 3e-7. Those of float32 on a
        # GPU round 19 times by 2^-24 of a bend of 0.5, and the inverse eigenvalues, 220 in the root
        # mean square, make 1.2e-4 of it; the largest of 450 000 errors is within four of these.
        tolerance=5e-4,
        bytes_per_pixel=12 + 4,
        operations_per_pixel=8 * 120,
        captures=False,
        work=Work("pixels", lambda normals: normals.shape[0] * normals.shape[1]),
        sizes=("1024x440",),
        margin=0,
    ),
)
