"""Points and surfaces of radiance fields, for other programs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    as_array,
    as_items,
    check_instance,
    check_integer,
    check_number,
    check_positive,
)
from cvkern._files import as_path, replacing
from cvkern.radiance._glb import glb
from cvkern.radiance.fields.field import View
from cvkern.radiance.models import Model
from cvkern.radiance.pinhole import Cameras, pixel_rays, project
from cvkern.radiance.rendering import RAYS, Renderer
from cvkern.radiance.wild.embeddings import light_of

__all__ = ["Cloud", "Mesh", "mesh", "point_cloud", "write_mesh"]

BEFORE = 2.0  # cells: distance from a surface at which its colour is viewed
VIEWS, PIXELS = 16, 128  # views, and pixels of their longer side, that tell which pieces are seen
CLOSE = 3.0  # cells between a corner and a surface that a view shows
SEEN = 0.1  # share of a piece's corners that views must show
SMOOTH, MOST = 2.0, 4.0  # sigma in cells, and bound as a multiple of the density at the surface


class Cloud(NamedTuple):
    """Points with colours."""

    points: np.ndarray
    """World positions, (N, 3) float32."""
    colors: np.ndarray
    """Red, green, blue, (N, 3) uint8."""


class Mesh(NamedTuple):
    """Triangles, with a colour at each corner."""

    points: np.ndarray
    """World positions of the corners, (N, 3) float32."""
    faces: np.ndarray
    """Numbers of the corners of each triangle, anticlockwise from outside, (F, 3) int32."""
    colors: np.ndarray
    """Red, green, blue of each corner, (N, 3) uint8."""


def point_cloud(
    model: Model, cameras: Cameras | None = None, *, views: Sequence[int] | np.ndarray | None = None
) -> Cloud:
    """Return the surface points that the pixels of some views show.

    Parameters
    ----------
    model : Model
    cameras : Cameras, optional
        By default ``model.cameras``.
    views : sequence of int, optional
        By default twelve of them, or all if there are fewer.

    Returns
    -------
    Cloud
        A point for each pixel whose ray is stopped by the field, with an opacity of at least one
        half; may be empty. ``cvkern.clouds.write_ply(path, *cloud)`` writes it.

    Raises
    ------
    TypeError
        If the index of a view is not an integer.
    ValueError
        If there is no such view, or its camera is more than 32768 half-sides of the scene's cube
        from its middle.
    """
    check_instance(model, Model, "model")
    if cameras is not None:
        check_instance(cameras, Cameras, "cameras")
    cameras = model.cameras if cameras is None else cameras
    if views is None:
        views = range(0, len(cameras), max(1, len(cameras) // 12))
    given = as_items(views, "views", "a sequence of integers")
    chosen = [check_integer(v, "views", 0, len(cameras) - 1) for v in given]
    model.frame.inside(cameras.poses[chosen])  # refuses distant cameras before the work
    draw, light = Renderer(model.field, model.rt), light_of(model, None)
    points, colors = [np.empty((0, 3), np.float32)], [np.empty((0, 3), np.uint8)]
    for view in chosen:
        seen = draw(cameras, view, model.behind, light)
        solid = np.isfinite(seen.depth)
        origins, directions = pixel_rays(cameras, view, np.argwhere(solid))
        places = origins + seen.depth[solid][:, None] * directions
        points.append(places.astype(np.float32))
        colors.append(np.round(255 * seen.color[solid]).astype(np.uint8))
    return Cloud(np.concatenate(points), np.concatenate(colors))


def mesh(
    model: Model,
    *,
    resolution: int = 128,
    density: float = 10.0,
    smooth: float = 1.0,
    pieces: int | None = 1,
) -> Mesh:
    """Return the surface on which a model's density has a given value, by marching cubes.

    Parameters
    ----------
    model : Model
    resolution : int, default 128
        Cells along a side of the scene's cube, from 8 to 1024. The part of the scene outside the
        cube is left out.
    density : float, default 10.0
        The value, per half of the cube's side, > 0. Over that length, the share ``exp(-density)``
        of the light gets through.
    smooth : float, default 1.0
        Standard deviation, in cells, of the Gaussian that smooths the density first, which is
        bounded to 4 times the value for that; 0 for none. Rough densities make many small pieces.
    pieces : int, optional
        Number of connected pieces to keep, those with the largest area; None for all. Pieces that
        the cameras of the photographs do not see are left out before: noise in space that no
        photograph shows makes thousands of them. If no piece is seen, all are kept.

    Returns
    -------
    Mesh
        Each corner has the colour seen along the normal of the smoothed surface. There are surfaces
        inside solids, too, because no photograph determines the density there.

    Raises
    ------
    ModuleNotFoundError
        If scikit-image is not installed.
    TypeError
        If a parameter is not a number.
    ValueError
        If a parameter is out of its range, or the density nowhere crosses the value.
    """
    check_instance(model, Model, "model")
    cells = check_integer(resolution, "resolution", 8, 1024)
    density = check_positive(density, "density")
    smooth = check_number(smooth, "smooth", low=0)
    if pieces is not None:
        pieces = check_integer(pieces, "pieces", 1, 2**31 - 1)
    try:
        from skimage.measure import marching_cubes
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "mesh needs the marching cubes of scikit-image: pip install 'cvkern[demo]'"
        ) from None
    from scipy.ndimage import gaussian_filter, map_coordinates

    rt, bounds = model.rt, model.frame.bounds
    axis = np.linspace(-1, 1, cells + 1, dtype=np.float32)
    grid = np.empty((cells + 3,) * 3, np.float32)
    grid[...] = 0  # the density is 0 outside, so the surface is closed
    plane = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=2).reshape(-1, 2)
    for i, x in enumerate(axis):  # one plane at a time, because all points would fill the memory
        points = np.column_stack((np.full(len(plane), x), plane))
        grid[i + 1, 1:-1, 1:-1] = model.field.densities(points).reshape(cells + 1, cells + 1)
    if not grid.max() > density:
        raise ValueError(
            f"density must be below the model's largest, {grid.max():g}, got {density:g}"
        )
    bounded = np.minimum(grid, MOST * density)  # it grows without limit in solids
    shape = gaussian_filter(bounded, smooth) if smooth else grid
    if not shape.max() > density:
        raise ValueError(f"smooth must leave a density above {density:g}, got {smooth:g}")
    at, faces, _, _ = marching_cubes(shape, density, gradient_direction="ascent")
    side = 2 / cells
    seen = _seen(model, bounds.half * (side * (at - 1) - 1) + bounds.center, CLOSE * side)
    at, faces = _chosen(at, faces, seen, pieces)
    # Colours are reliable only along directions that photographs have. The density is rough, so
    # view along the normals of a smoothed density.
    even = gaussian_filter(bounded, SMOOTH)
    slopes = [
        map_coordinates(even, (at + step).T, order=1)
        - map_coordinates(even, (at - step).T, order=1)
        for step in np.eye(3)
    ]
    normals = -np.stack(slopes, axis=1).astype(np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    corners = (side * (at - 1) - 1).astype(np.float32)
    faces = np.ascontiguousarray(faces, np.int32)
    # Rays begin at the distance `near`, so their origins are that much farther away.
    away = model.frame.near + BEFORE * side
    colors = _looked_at(model, rt, corners + np.float32(away) * normals, -normals)
    points = bounds.half * corners + np.array(bounds.center, np.float32)
    return Mesh(points.astype(np.float32), faces, colors)


def _seen(model: Model, points: np.ndarray, close: float) -> np.ndarray:
    """Tell which points lie on a surface that a photograph's camera sees, up to a distance."""
    views = model.cameras
    views = views.resized(
        max(1, min(max(views.height, views.width) // PIXELS, views.height, views.width))
    )
    seen = np.zeros(len(points), bool)
    draw, light = Renderer(model.field, model.rt), light_of(model, None)
    for view in range(0, len(views), -(-len(views) // VIEWS)):
        depth = np.asarray(draw(views, view, model.behind, light).depth)
        at = project(views, view, points)
        within = ((at > -0.5) & (at < np.array(depth.shape) - 0.5)).all(axis=1)  # NaN is not
        row, column = np.round(at[within]).astype(int).T
        away = np.linalg.norm(points[within] - views.poses[view][:, 3], axis=1)
        seen[within] |= np.abs(away - depth[row, column]) < close * model.frame.bounds.half
    return seen


def _chosen(
    points: np.ndarray, faces: np.ndarray, seen: np.ndarray, pieces: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and faces of connected pieces that are seen, those with large areas."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = np.concatenate((faces[:, :2], faces[:, 1:]))
    links = coo_array((np.ones(len(edges), bool), edges.T), shape=(len(points),) * 2)
    count, piece_of = connected_components(links, directed=False)
    kept = np.bincount(piece_of, seen, count) >= SEEN * np.bincount(piece_of, minlength=count)
    if not kept.any():
        kept[:] = True
    if pieces is not None:
        a, b, c = points[faces.T]
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        sizes = np.where(kept, np.bincount(piece_of[faces[:, 0]], areas, count), -1)
        kept[np.argsort(-sizes, kind="stable")[pieces:]] = False
    own = kept[piece_of]
    number = np.cumsum(own) - 1
    return points[own], number[faces[own[faces[:, 0]]]]


def _looked_at(model: Model, rt: Any, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return the colours that rays of the frame see at a short distance, (N, 3) uint8."""
    colors = np.empty((len(origins), 3), np.uint8)
    draw, light = Renderer(model.field, rt), light_of(model, None)
    for begin in range(0, len(origins), RAYS):
        part = slice(begin, begin + RAYS)
        rays = rt.send("mesh.origins", origins[part]), rt.send("mesh.directions", directions[part])
        count = len(origins[part])
        shapes = {"color": (count, 3), "opacity": (count,), "depth": (count,)}
        seen = View(*(rt.scratch(f"mesh.{name}", shape) for name, shape in shapes.items()))
        draw.look(*rays, seen, light)
        opacity = np.maximum(rt.to_numpy(seen.opacity)[:, None], 1e-3)
        colors[part] = np.round(255 * (rt.to_numpy(seen.color) / opacity).clip(0, 1))
    return colors


def write_mesh(path: str | os.PathLike[str], surface: Mesh) -> None:
    """Write a mesh as binary PLY (little-endian) or binary glTF 2.0, whole or not at all.

    Parameters
    ----------
    path : path
        Ends in ``.ply`` or ``.glb``; an existing file is replaced once the new one is complete. In
        a ``.glb`` the points are as they are, a node turns the z axis upwards, as Blender's scenes
        have it (glTF's y axis is up), and colours are linear.
    surface : Mesh

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    TypeError
        If an array of `surface` has another kind of numbers.
    ValueError
        If `path` ends otherwise, the arrays do not match, or a ``.glb`` would have no triangle.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from cvkern.radiance import Mesh, write_mesh
    >>> corners, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_mesh(f"{folder}/one.ply", Mesh(corners, faces, np.zeros((3, 3), np.uint8)))
    ...     Path(folder, "one.ply").stat().st_size
    287
    """
    check_instance(surface, Mesh, "surface")
    suffix = as_path(path).suffix.lower()
    if suffix not in (".ply", ".glb"):
        raise ValueError(f"path must end in .ply or .glb, got {os.fspath(path)!r}")
    place = [(name, "<f4") for name in ("x", "y", "z")]
    tint = [(name, "u1") for name in ("red", "green", "blue")]
    points, faces, colors = _checked(surface)
    if suffix == ".glb":
        with replacing(path) as beside:
            beside.write_bytes(glb(points, faces, colors))
        return
    table = np.empty(len(points), place + tint)
    columns = [*points.T, *colors.T]
    for (name, _), column in zip(place + tint, columns, strict=True):
        table[name] = column
    triangles = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, faces
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property float {name}" for name, _ in place]
    head += [f"property uchar {name}" for name, _ in tint]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    with replacing(path) as beside, beside.open("wb") as file:
        file.write("\n".join([*head, "end_header", ""]).encode("ascii"))
        file.write(table.tobytes())
        file.write(triangles.tobytes())


def _checked(surface: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points, faces and colours as they are written."""
    arrays = []
    for name, kinds, rule in (
        ("points", "f", "floating"), ("faces", "iu", "integers"), ("colors", "u", "uint8"),
    ):  # fmt: skip
        array = np.asarray(as_array(getattr(surface, name), f"surface.{name}"))
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"surface.{name} must have shape (N, 3), got {array.shape}")
        if array.dtype.kind not in kinds or (rule == "uint8" and array.dtype != np.uint8):
            raise TypeError(f"surface.{name} must be {rule}, got {array.dtype}")
        arrays.append(array)
    points, faces, colors = arrays
    if len(colors) != len(points):
        raise ValueError(
            f"surface.colors must be as many as points, {len(points)}, got {len(colors)}"
        )
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
        raise ValueError(f"surface.faces must be numbers of {len(points)} points, got others")
    return points, faces, colors
