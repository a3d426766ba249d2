"""Triangles as a camera sees them along parallel rays, in Warp.

The Taichi set has the rule. One thread takes a triangle; on the CPU, a slab of triangles.
"""

import warp as wp

from cvkern.kernels.codes.shading import DEPTH_STEPS, NOTHING
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

STEPS = wp.constant(DEPTH_STEPS)
EMPTY = wp.constant(wp.int64(NOTHING))


@wp.func
def _corners(vertices: wp.array2d[float], faces: wp.array2d[int], i: int):
    """Return the corners of a triangle: a row each, with column, row and depth."""
    m = wp.mat33()
    for k in range(3):
        v = faces[i, k]
        m[k, 0] = vertices[v, 0]
        m[k, 1] = -vertices[v, 1]
        m[k, 2] = -vertices[v, 2]
    return m


@wp.func
def _shares(m: wp.mat33, x: float, y: float):
    """Return the shares of the corners in a point, or a negative one where it lies outside."""
    a = (m[1, 0] - x) * (m[2, 1] - y) - (m[2, 0] - x) * (m[1, 1] - y)
    b = (m[2, 0] - x) * (m[0, 1] - y) - (m[0, 0] - x) * (m[2, 1] - y)
    c = (m[0, 0] - x) * (m[1, 1] - y) - (m[1, 0] - x) * (m[0, 1] - y)
    total = a + b + c
    if total == 0.0:
        return wp.vec3(-1.0, 0.0, 0.0)
    return wp.vec3(a / total, b / total, c / total)


@wp.func
def _depth(m: wp.mat33, s: wp.vec3):
    return s[0] * m[0, 2] + s[1] * m[1, 2] + s[2] * m[2, 2]


def cover(vertices: wp.array, faces: wp.array, keys: wp.array) -> None:
    """Lower the key of each pixel to that of the nearest triangle: its depth, then its number."""
    launch_each(_cover, faces.shape[0], 16 * faces.shape[0], [vertices, faces], [keys])


@wp.kernel
def _cover(
    stride: int,
    first: int,
    last: int,
    vertices: wp.array2d[float],  # (x right, y up, z towards the camera)
    faces: wp.array2d[int],
    # outputs
    keys: wp.array2d[wp.int64],
):
    for i in range(first + wp.tid(), last, stride):
        m = _corners(vertices, faces, i)
        left = wp.max(int(wp.ceil(wp.min(m[0, 0], wp.min(m[1, 0], m[2, 0])))), 0)
        right = wp.min(int(wp.floor(wp.max(m[0, 0], wp.max(m[1, 0], m[2, 0])))), keys.shape[1] - 1)
        top = wp.max(int(wp.ceil(wp.min(m[0, 1], wp.min(m[1, 1], m[2, 1])))), 0)
        bottom = wp.min(int(wp.floor(wp.max(m[0, 1], wp.max(m[1, 1], m[2, 1])))), keys.shape[0] - 1)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                s = _shares(m, float(x), float(y))
                if s[0] >= 0.0 and s[1] >= 0.0 and s[2] >= 0.0:
                    depth = wp.int64(wp.floor(_depth(m, s) * STEPS + 0.5))
                    key = depth * wp.int64(4294967296) + wp.int64(i)
                    wp.atomic_min(keys, y, x, key)


def resolve(
    vertices: wp.array,
    faces: wp.array,
    bends: wp.array,
    keys: wp.array,
    depth: wp.array,
    normals: wp.array,
) -> None:
    """Write depth and normals of the triangles that pixels see, NaN where they see none."""
    inputs = [vertices, faces, bends, keys]
    launch_each(_resolve, keys.size, 8 * keys.size, inputs, [depth, normals])


@wp.kernel
def _resolve(
    stride: int,
    first: int,
    last: int,
    vertices: wp.array2d[float],
    faces: wp.array2d[int],
    bends: wp.array2d[float],  # normals of the vertices
    keys: wp.array2d[wp.int64],
    # outputs
    depth: wp.array2d[float],
    normals: wp.array3d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // keys.shape[1]
        x = i % keys.shape[1]
        if keys[y, x] == EMPTY:
            depth[y, x] = wp.nan
            for c in range(3):
                normals[y, x, c] = wp.nan
        else:
            face = int(keys[y, x] & wp.int64(4294967295))
            m = _corners(vertices, faces, face)
            s = _shares(m, float(x), float(y))
            depth[y, x] = _depth(m, s)
            n = wp.vec3()
            for c in range(3):
                for k in range(3):
                    n[c] = n[c] + s[k] * bends[faces[face, k], c]
            length = wp.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
            for c in range(3):
                normals[y, x, c] = n[c] / length
