"""Meshes of reliefs: from depth, and their orthographic view."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_numbers, check_image, check_sides
from cvkern._runtime import Runtime
from cvkern.kernels.codes.shading import NOTHING

MOST_PLACE = 2.0**18  # pixels: larger depths do not fit into their half of a key


class Mesh(NamedTuple):
    """Triangles in space: x right (column), y up (minus the row), z towards the camera."""

    vertices: Any
    """Positions, (V, 3) float32, in pixels."""
    faces: Any
    """Corners of each triangle, (F, 3) int32, counter-clockwise as the camera sees them."""


def mesh_from_depth(depth: Any) -> Mesh:
    """Make a mesh of triangles from a depth map.

    Parameters
    ----------
    depth : array of shape (H, W)
        Depth in pixels, growing away from the camera; NaN where there is nothing. Any real dtype.

    Returns
    -------
    Mesh
        Named tuple of NumPy arrays, `vertices` (V, 3) float32 and `faces` (F, 3) int32. There is
        one vertex for each finite pixel, row by row, and two triangles for each square of four.

    Raises
    ------
    TypeError
        If `depth` does not hold real numbers.
    ValueError
        If `depth` is empty or not 2-D.

    See Also
    --------
    integrate_normals : Depth from normals.
    lambertian : Render the mesh.

    Examples
    --------
    >>> import cvkern
    >>> mesh = cvkern.mesh_from_depth([[0, 0, 1], [0, 2, 1]])
    >>> mesh.vertices.shape, mesh.faces.shape
    ((6, 3), (4, 3))
    """
    depth = np.asarray(check_image(depth, name="depth"), np.float32)
    there = np.isfinite(depth)
    numbers = np.cumsum(there.ravel(), dtype=np.int32).reshape(there.shape) - 1
    rows, columns = np.nonzero(there)
    vertices = np.stack([columns, -rows, -depth[there]], axis=1).astype(np.float32)
    square = there[:-1, :-1] & there[1:, :-1] & there[:-1, 1:] & there[1:, 1:]
    a, b, c, d = (
        part[square]
        for part in (numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:])
    )
    corners = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1)
    return Mesh(vertices, corners.reshape(-1, 3).astype(np.int32))


def check_mesh(mesh: Any) -> Mesh:
    """Return a mesh with float32 vertices and int32 faces on the host, all within range."""
    vertices, faces = mesh
    vertices, faces = as_numbers(vertices, "vertices", np.float32), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not len(vertices):
        raise ValueError(f"vertices must have shape (V, 3), got {vertices.shape}")
    if faces.dtype.kind not in "iu":
        raise TypeError(f"faces must be integers, got dtype {faces.dtype}")
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise ValueError(f"faces must have shape (F, 3), got {faces.shape}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(
            f"faces must be indices of {len(vertices)} vertices, got {faces.min()} to {faces.max()}"
        )
    if not (np.abs(vertices) < MOST_PLACE).all():
        raise ValueError(f"vertices must be finite and within {MOST_PLACE:g} pixels, got others")
    return Mesh(vertices, faces.astype(np.int32))


def see_mesh(rt: Runtime, mesh: Mesh, shape: Any) -> tuple[Any, Any]:
    """Return kernel arrays of the depth and the normals that each pixel sees."""
    height, width = check_sides(shape, "shape")
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    bends = np.zeros((len(mesh.vertices), 3))
    for k in range(3):
        for c in range(3):
            bends[:, c] += np.bincount(mesh.faces[:, k], across[:, c], len(bends))
    vertices, faces = rt.adopt(mesh.vertices), rt.adopt(mesh.faces, np.int32)
    keys = rt.send("mesh.keys", np.full((height, width), NOTHING, np.int64))
    depth, normals = (
        rt.scratch("mesh.depth", (height, width)),
        rt.scratch("mesh.normals", (height, width, 3)),
    )
    rt.shading.meshes.cover(vertices, faces, keys)
    rt.shading.meshes.resolve(vertices, faces, rt.adopt(bends), keys, depth, normals)
    return depth, normals
