"""Triangles as a camera sees them along parallel rays, in Taichi: one thread a triangle.

A pixel belongs to a triangle whose edges all have it on one side, or on them. Of several, the
nearest one wins, in steps of 1/4096 pixel, then the first: one integer key has both, and its least
value does not depend on the order of the threads.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.shading import DEPTH_STEPS, NOTHING
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, root

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)


@ti.func
def _corners(vertices: ti.template(), faces: ti.template(), i: ti.i32):
    """Return the corners of a triangle: a row each, with column, row and depth."""
    m = ti.Matrix.zero(ti.f32, 3, 3)
    for k in ti.static(range(3)):
        v = faces[i, k]
        m[k, 0] = vertices[v, 0]
        m[k, 1] = -vertices[v, 1]
        m[k, 2] = -vertices[v, 2]
    return m


@ti.func
def _shares(m: ti.template(), x: ti.f32, y: ti.f32, zero: ti.i32):
    """Return the shares of the corners in a point, or a negative one where it lies outside."""
    a = product(m[1, 0] - x, m[2, 1] - y, zero) - product(m[2, 0] - x, m[1, 1] - y, zero)
    b = product(m[2, 0] - x, m[0, 1] - y, zero) - product(m[0, 0] - x, m[2, 1] - y, zero)
    c = product(m[0, 0] - x, m[1, 1] - y, zero) - product(m[1, 0] - x, m[0, 1] - y, zero)
    total = a + b + c
    s = ti.math.vec3(-1.0, 0.0, 0.0)
    if total != 0.0:
        s[0] = quotient(a, total, zero)
        s[1] = quotient(b, total, zero)
        s[2] = quotient(c, total, zero)
    return s


@ti.func
def _depth(m: ti.template(), s: ti.template(), zero: ti.i32) -> ti.f32:
    depth = product(s[0], m[0, 2], zero) + product(s[1], m[1, 2], zero)
    return depth + product(s[2], m[2, 2], zero)


@ti.kernel
def _cover(
    vertices: f32_2,  # (x right, y up, z towards the camera)
    faces: i32_2,
    zero: ti.i32,
    # outputs
    keys: i64_2,
):
    for i in range(faces.shape[0]):
        m = _corners(vertices, faces, i)
        left = ti.max(ti.cast(ti.ceil(ti.min(m[0, 0], m[1, 0], m[2, 0])), ti.i32), 0)
        right = ti.cast(ti.floor(ti.max(m[0, 0], m[1, 0], m[2, 0])), ti.i32)
        right = ti.min(right, keys.shape[1] - 1)
        top = ti.max(ti.cast(ti.ceil(ti.min(m[0, 1], m[1, 1], m[2, 1])), ti.i32), 0)
        bottom = ti.cast(ti.floor(ti.max(m[0, 1], m[1, 1], m[2, 1])), ti.i32)
        bottom = ti.min(bottom, keys.shape[0] - 1)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                s = _shares(m, ti.cast(x, ti.f32), ti.cast(y, ti.f32), zero)
                if s[0] >= 0.0 and s[1] >= 0.0 and s[2] >= 0.0:
                    steps = product(_depth(m, s, zero), ti.cast(DEPTH_STEPS, ti.f32), zero)
                    key = ti.cast(ti.floor(steps + 0.5), ti.i64) * ti.i64(4294967296)
                    ti.atomic_min(keys[y, x], key + ti.cast(i, ti.i64))


@primitive
def cover(vertices: np.ndarray, faces: np.ndarray, keys: np.ndarray) -> None:
    """Lower the key of each pixel to that of the nearest triangle: its depth, then its number."""
    _cover(vertices, faces, 0, keys)


@ti.kernel
def _resolve(
    vertices: f32_2,
    faces: i32_2,
    bends: f32_2,  # normals of the vertices
    keys: i64_2,
    zero: ti.i32,
    # outputs
    depth: f32_2,
    normals: f32_3,
):
    for y, x in depth:
        if keys[y, x] == ti.i64(NOTHING):
            depth[y, x] = ti.cast(ti.math.nan, ti.f32)
            for c in range(3):
                normals[y, x, c] = ti.cast(ti.math.nan, ti.f32)
        else:
            face = ti.cast(keys[y, x] & ti.i64(4294967295), ti.i32)
            m = _corners(vertices, faces, face)
            s = _shares(m, ti.cast(x, ti.f32), ti.cast(y, ti.f32), zero)
            depth[y, x] = _depth(m, s, zero)
            n = ti.math.vec3(0.0)
            for c in ti.static(range(3)):
                for k in ti.static(range(3)):
                    n[c] += product(s[k], bends[faces[face, k], c], zero)
            length = product(n[0], n[0], zero) + product(n[1], n[1], zero)
            length = root(length + product(n[2], n[2], zero), zero)
            for c in ti.static(range(3)):
                normals[y, x, c] = quotient(n[c], length, zero)


@primitive
def resolve(
    vertices: np.ndarray,
    faces: np.ndarray,
    bends: np.ndarray,
    keys: np.ndarray,
    depth: np.ndarray,
    normals: np.ndarray,
) -> None:
    """Write depth and normals of the triangles that pixels see, NaN where they see none."""
    _resolve(vertices, faces, bends, keys, 0, depth, normals)
