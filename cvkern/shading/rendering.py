"""Rendering of matt surfaces under lights, and its gradients."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    FLOAT32_MAX,
    as_array,
    as_numbers,
    check_choice,
    check_image,
    check_number,
)
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.kernels.codes.shading import DIRECTIONAL, HARMONIC
from cvkern.shading.meshes import check_mesh, see_mesh

SHADOWS = ("none", "attached", "cast")
# Constants of the real harmonics, in the order of the kernels' polynomials, times the coefficients
# of the clamped cosine over pi: 1, 2/3, 1/4 by degree.
HARMONICS = np.array(
    [
        math.sqrt(1 / (4 * math.pi)),
        *[2 / 3 * math.sqrt(3 / (4 * math.pi))] * 3,
        *[1 / 4 * math.sqrt(15 / (4 * math.pi))] * 2,
        1 / 4 * math.sqrt(5 / (16 * math.pi)),
        1 / 4 * math.sqrt(15 / (4 * math.pi)),
        1 / 4 * math.sqrt(15 / (16 * math.pi)),
    ]
)


class LambertianGradient(NamedTuple):
    """Gradients of a loss with respect to the inputs of :func:`lambertian`."""

    surface: Any
    lights: Any
    albedo: Any


def lambertian(
    surface: Any,
    lights: Any,
    *,
    albedo: Any = 1.0,
    shadows: str = "attached",
    shape: tuple[int, int] | None = None,
) -> Any:
    """Render a matt surface under each light.

    Parameters
    ----------
    surface : array of shape (H, W, 3) or (H, W), or a `Mesh`
        Unit normals; or depth in pixels, growing away from the camera; or a pair (vertices, faces)
        with x to the right, y up and z towards the camera, in pixels. NaN means no surface.
    lights : array of shape (3,), (K, 3), (9,) or (K, 9)
        Vectors towards distant lights, whose length is their strength; or nine coefficients of the
        sky's real spherical harmonics of degree 0, 1 and 2: 1, y, z, x, xy, yz, 3z^2 - 1, xz,
        x^2 - y^2. Both are in the axes of normals: x right, y up, z towards the camera.
    albedo : float or array of shape (H, W), default 1.0
        Share of the light that a pixel reflects.
    shadows : {'attached', 'none', 'cast'}, default 'attached'
        `attached` makes pixels that face away from the light 0. `none` leaves negative values
        there. `cast` adds cast shadows; it requires depth or a mesh, and lights that are vectors.
    shape : (int, int), optional
        Height and width of the images; only for a mesh, and required there. Pixel (r, c) sees the
        triangles at x = c, y = -r.

    Returns
    -------
    array of shape (K, H, W) or (H, W), float32
        The images, 0 where there is no surface. The array is of the same library and on the same
        device as `surface`; NumPy for a mesh.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, lights are not finite, `albedo` is negative, or cast shadows are
        requested for normals or harmonics.

    See Also
    --------
    lambertian_backward : The gradients.
    photometric_stereo : The inverse, from images to normals.

    Notes
    -----
    These axes are the one exception to the rules of the library: y points up.

    A light l gives ``albedo * max(0, l . n)``. The nine coefficients L of a sky give
    ``albedo / pi`` times its irradiance, which harmonics of degree 2 approximate to a percent [1]_.
    The normals of a depth map come from central differences, or one-sided ones beside pixels that
    are not finite.

    References
    ----------
    .. [1] R. Ramamoorthi and P. Hanrahan, "An efficient representation for irradiance environment
       maps", SIGGRAPH 2001.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> depth = np.array([[4.0, 3, 2], [4, 3, 2], [4, 3, 2]])  # a ramp that faces left
    >>> cvkern.lambertian(depth, [[-1, 0, 0], [1, 0, 0]])[:, 1].round(3)
    array([[0.707, 0.707, 0.707],
           [0.   , 0.   , 0.   ]], dtype=float32)
    """
    given = check_lights(lights)
    shadows = check_choice(shadows, SHADOWS, "shadows")
    harmonic = given.shape[1] == HARMONIC
    mesh = None
    if is_mesh(surface):
        mesh = check_mesh(surface)
        if shape is None:
            raise ValueError("shape must be given for a mesh, got None")
        rt = runtime(mesh.vertices)
    else:
        surface = check_surface(surface)
        if shape is not None:
            raise ValueError(f"shape must be None for normals and depth, got {shape}")
        rt = runtime(surface)
    if shadows == "cast" and (harmonic or (mesh is None and len(surface.shape) == 3)):
        raise ValueError(
            "shadows must be 'attached' or 'none' for normals or harmonics, got 'cast'"
        )
    if mesh is not None:
        check_albedo(albedo, tuple(shape))  # pyright: ignore[reportArgumentType]
        depth, normals = see_mesh(rt, mesh, shape)
    else:
        check_albedo(albedo, tuple(surface.shape[:2]))
        depth, normals = seen_surface(rt, surface)
    seen = tuple(normals.shape[:2])
    lamps = kernel_lights(rt, given)
    lit = cast_shadows(rt, depth, lamps, len(given)) if shadows == "cast" else unlit(rt)
    result = rt.empty((len(given), *seen))
    rt.shading.rendering.shade(
        normals, lamps, kernel_albedo(rt, albedo, seen), lit, shadows != "none", rt.adopt(result)
    )
    result = rt.release(result)
    return result[0] if np.ndim(lights) == 1 else result


def lambertian_backward(
    grad: Any, surface: Any, lights: Any, *, albedo: Any = 1.0, shadows: str = "attached"
) -> LambertianGradient:
    """Return the gradients of :func:`lambertian` for the surface, the lights and the albedo.

    Parameters
    ----------
    grad : array of the shape that `lambertian` returns
        Gradient of a loss with respect to the images.
    surface : array of shape (H, W, 3) or (H, W)
        Normals or depth, as given to :func:`lambertian`; not a mesh.
    lights, albedo, shadows
        As given to :func:`lambertian`.

    Returns
    -------
    surface : array of the shape of `surface`, float32
        Gradient for each component of the normals, without a constraint of length 1, or for depth.
        Shadows are treated as constant. 0 where the surface is not finite.
    lights : array of the shape of `lights`, float64
        A NumPy array.
    albedo : array of shape (H, W), float32

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, or :func:`lambertian` refuses an argument.

    Examples
    --------
    >>> import cvkern
    >>> normals, grad = [[[0, 0, 1]]], [[[2.0]]]
    >>> found = cvkern.lambertian_backward(grad, normals, [[0.6, 0, 0.8]], albedo=0.5)
    >>> found.albedo, found.lights
    (array([[1.6]], dtype=float32), array([[0., 0., 1.]]))
    """
    given = check_lights(lights)
    shadows = check_choice(shadows, SHADOWS, "shadows")
    surface = check_surface(surface)
    seen, flat = tuple(surface.shape[:2]), np.ndim(lights) == 1
    if shadows == "cast" and (len(surface.shape) == 3 or given.shape[1] == HARMONIC):
        raise ValueError(
            "shadows must be 'attached' or 'none' for normals or harmonics, got 'cast'"
        )
    check_albedo(albedo, seen)
    grad = check_image(grad, ndim=(2, 3), name="grad")
    wanted = seen if flat else (len(given), *seen)
    if tuple(grad.shape) != wanted:
        raise ValueError(f"grad must have shape {wanted}, got {tuple(grad.shape)}")
    rt = runtime(surface, grad)
    depth, normals = seen_surface(rt, surface)
    lamps = kernel_lights(rt, given)
    lit = cast_shadows(rt, depth, lamps, len(given)) if shadows == "cast" else unlit(rt)
    inputs = (
        rt.adopt(grad, np.float32, (len(given), *seen)), normals, lamps,
        kernel_albedo(rt, albedo, seen), lit, shadows != "none",
    )  # fmt: skip
    by_surface, by_albedo = rt.empty(tuple(surface.shape)), rt.empty(seen)
    rendering = rt.shading.rendering
    if len(surface.shape) == 3:
        rendering.shade_gradients(*inputs, rt.adopt(by_surface), rt.adopt(by_albedo))
    else:
        by_normals = rt.scratch("shading.by_normals", (*seen, 3))
        slopes = rt.scratch("shading.by_slopes", (*seen, 2))
        rendering.shade_gradients(*inputs, by_normals, rt.adopt(by_albedo))
        rendering.slope_gradients(depth, by_normals, slopes)
        rendering.depth_gradients(depth, slopes, rt.adopt(by_surface))
    rows = rt.scratch("shading.by_lights", (seen[0], *given.shape), np.float64)
    rendering.light_gradients(*inputs, rows)
    with np.errstate(over="ignore", invalid="ignore"):  # albedos and surfaces may be infinite
        by_lights = rt.to_numpy(rows).sum(axis=0)
    if given.shape[1] == HARMONIC:
        by_lights = by_lights * HARMONICS
    return LambertianGradient(
        rt.release(by_surface), by_lights.reshape(np.shape(lights)), rt.release(by_albedo)
    )


def is_mesh(surface: Any) -> bool:
    """Tell whether a surface is a pair of vertices and faces."""
    return isinstance(surface, tuple) and len(surface) == 2 and np.ndim(surface[0]) == 2


def check_surface(surface: Any) -> Any:
    """Return normals or depth as an array of real values."""
    surface = check_image(surface, ndim=(2, 3), name="surface")
    if len(surface.shape) == 3 and surface.shape[2] != 3:
        raise ValueError(f"surface must have shape (H, W) or (H, W, 3), got {tuple(surface.shape)}")
    return surface


def check_lights(lights: Any) -> np.ndarray:
    """Return lights as (K, 3) or (K, 9) float64 on the host."""
    given = as_numbers(lights, "lights")
    shape = given.shape
    if given.ndim not in (1, 2) or shape[-1] not in (DIRECTIONAL, HARMONIC) or not given.size:
        raise ValueError(f"lights must have shape (K, 3) or (K, 9), got {shape}")
    if not (np.abs(given) <= FLOAT32_MAX).all():
        raise ValueError("lights must be finite, got others")
    return given.reshape(-1, shape[-1])


def kernel_lights(rt: Runtime, given: np.ndarray) -> Any:
    """Return lights for kernels; harmonics are multiplied by the constants of the polynomials."""
    given = given * HARMONICS if given.shape[1] == HARMONIC else given
    return rt.constant(given.astype(np.float32))


def check_albedo(albedo: Any, shape: tuple[int, int]) -> None:
    """Refuse an albedo that is neither a number nor an image of the given shape."""
    albedo = as_array(albedo, "albedo")
    if np.ndim(albedo) == 0:
        check_number(albedo, "albedo", low=0)
    elif tuple(check_image(albedo, name="albedo").shape) != shape:
        raise ValueError(f"albedo must have shape {shape}, got {tuple(albedo.shape)}")


def kernel_albedo(rt: Runtime, albedo: Any, shape: tuple[int, int]) -> Any:
    """Return albedo for kernels, one value for each pixel."""
    if np.ndim(albedo) == 0:
        return rt.send("shading.albedo", np.full(shape, albedo, np.float32))
    return rt.adopt(check_image(albedo, name="albedo"))


def seen_surface(rt: Runtime, surface: Any) -> tuple[Any, Any]:
    """Return kernel arrays of depth, if the surface is depth, and of normals."""
    if len(surface.shape) == 3:
        return None, rt.adopt(surface)
    depth = rt.adopt(surface)
    normals = rt.scratch("shading.normals", (*surface.shape, 3))
    rt.shading.rendering.normals(depth, normals)
    return depth, normals


def cast_shadows(rt: Runtime, depth: Any, lamps: Any, count: int) -> Any:
    """Return which pixels each light reaches, as a kernel array."""
    refuse_capture("lambertian with cast shadows")
    values = rt.to_numpy(depth)
    known = values[np.isfinite(values)]
    lit = rt.scratch("shading.lit", (count, *values.shape), np.uint8)
    top = float(known.min()) if known.size else 0.0
    rt.shading.rendering.cast(depth, lamps, top, lit)
    return lit


def unlit(rt: Runtime) -> Any:
    """Return the empty array that kernels take if there are no cast shadows."""
    return rt.scratch("shading.unlit", (0, 1, 1), np.uint8)


def normals_from_depth(depth: Any) -> Any:
    """Return the unit normals of a depth map.

    Parameters
    ----------
    depth : array of shape (H, W)
        Depth in pixels, growing away from the camera; NaN where there is nothing. Any real dtype.

    Returns
    -------
    array of shape (H, W, 3), float32
        Normals (x right, y up, z towards the camera); NaN where `depth` is not finite. They come
        from central differences, or one-sided ones at the border and beside pixels that are not
        finite. The array is of the same library and on the same device as `depth`.

    Raises
    ------
    TypeError
        If `depth` does not hold real numbers.
    ValueError
        If `depth` is empty or not 2-D.

    See Also
    --------
    integrate_normals : The inverse.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.normals_from_depth([[0, 1], [0, 1]])[0, 0].round(3)
    array([0.707, 0.   , 0.707], dtype=float32)
    """
    depth = check_image(depth, name="depth")
    rt = runtime(depth)
    result = rt.empty((*depth.shape, 3))
    rt.shading.rendering.normals(rt.adopt(depth), rt.adopt(result))
    return rt.release(result)
