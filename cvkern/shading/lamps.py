"""Estimation of lights from images of a chrome sphere, or of the surface itself."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._checks import check_choice
from cvkern.shading.masks import host_mask
from cvkern.shading.photometry import check_images, check_lit

HIGHLIGHT = 0.9  # share of the brightest value above which a pixel belongs to the highlight
MOST_PIXELS = 40000  # pixels sampled for the estimation of unknown lights
DARK = 0.02  # share of a pixel's mean below which it is in shadow
SMOOTHED = (0.0, 1.0, 2.0, 4.0)  # pixels; the first one with a clear result, else the clearest
CLEAR = 0.2  # ratio of the two least singular values of integrability: below it, a clear result
MOST_ALIKE = 0.5  # the same ratio: above it, the result is undetermined
FILLS = 10  # rounds in which the model fills shadows
# Sensitivity of the assumption to the two slants and the logarithm of the flattening, in root mean
# square changes of relative strength: with lamps on a ring it is 0 for the flattening. Measured are
# 0.1 and more for lamps in all directions, and 0.016 for a ring whose slants vary by 2 degrees.
LEAST_CHANGE = 0.03  # below it, lights that are equal to 3 % tell a factor e in depth from none
LEAST_RATIO = 0.01  # the same, as a share of the largest: below it, the answer follows the noise
MOST_LEFT = 2.0  # unexplained change of albedo, in changes that a factor e in depth makes


def lights_from_sphere(images: Any, mask: Any) -> np.ndarray:
    """Find the directions of distant lights from images of a chrome sphere.

    Parameters
    ----------
    images : array of shape (K, H, W)
        One image for each light, of any real dtype. A sequence of K NumPy images also works.
    mask : array of shape (H, W)
        Pixels of the sphere are not 0. The whole sphere must be visible and round.

    Returns
    -------
    ndarray of shape (K, 3), float64
        Unit vectors towards the lights: x right, y up, z towards the camera.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, `mask` is 0 everywhere, or an image shows no light on the sphere.

    See Also
    --------
    photometric_stereo : Normals from images under these lights.
    estimate_lights : Lights without a sphere.

    Notes
    -----
    The centre and radius of the sphere are those of a disc with the mask's centre of mass and area.
    The highlight is the centroid of all pixels above 90 % of the brightest value. There the normal
    n bisects the angle between the light l and the direction v to a distant camera:
    ``l = 2 (n . v) n - v``.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.indices((41, 41)) - 20
    >>> shiny = np.stack([(abs(x - 10) < 2) & (abs(y) < 2)] * 3)
    >>> light = cvkern.lights_from_sphere(shiny, x**2 + y**2 < 400)[0]
    >>> print(f"{light[0]:.1f} {light[2]:.1f}")
    0.9 0.5
    """
    images = check_lit(images)
    shape = tuple(images.shape[1:])
    inside = host_mask(mask, shape)
    rows, columns = np.nonzero(inside)
    middle, radius = (rows.mean(), columns.mean()), np.sqrt(len(rows) / np.pi)
    lights = []
    for k, image in enumerate(np.asarray(images, np.float64)):
        values = np.where(np.isfinite(image), image, 0)[rows, columns]
        if not values.max() > 0:
            raise ValueError(f"images must show a light on the sphere, got none in image {k}")
        bright = values >= HIGHLIGHT * values.max()
        x = (columns[bright].mean() - middle[1]) / radius
        y = (middle[0] - rows[bright].mean()) / radius
        n = np.array([x, y, np.sqrt(max(1 - x * x - y * y, 0.0))])
        n /= np.linalg.norm(n)
        lights.append(2 * n[2] * n - np.array([0, 0, 1]))
    return np.array(lights)


def estimate_lights(images: Any, *, mask: Any = None, equal: str = "lights") -> np.ndarray:
    """Find the lights from images of a matt surface, without further measurements.

    Parameters
    ----------
    images : array of shape (K, H, W)
        At least four images, linear in light, of a curved surface. Any real dtype. A sequence of K
        NumPy images also works.
    mask : array of shape (H, W), optional
        Pixels of the surface are not 0. By default all pixels.
    equal : {'lights', 'albedo'}, default 'lights'
        The quantity that is assumed constant: the strength of the lights, or the albedo.

    Returns
    -------
    ndarray of shape (K, 3), float64
        Vectors towards the lights, with a mean strength of 1: x right, y up, z towards the camera.

    Raises
    ------
    TypeError
        If `images` does not hold real numbers.
    ValueError
        If there are fewer than four images, a shape does not match, `mask` is 0 everywhere, the
        images do not have three independent lights or do not determine them (lights on a ring, a
        surface that is too flat, noise), or `equal` is unknown.

    See Also
    --------
    photometric_stereo : Normals from images under these lights.

    Notes
    -----
    Images of a matt surface have rank 3. Their factors are the lights and the normals up to a 3 x 3
    matrix. Integrability of the normals reduces this to the bas-relief ambiguity: two slants and a
    flattening [1]_ [2]_. The assumption of equal lights or equal albedo resolves it; if neither
    holds, the depth is slanted or flattened. Lights on a ring about the view have equal strengths
    at any flattening: they need one light more, from another slant, or equal albedo. Images cannot
    distinguish a convex from a concave surface: a convex one is assumed. Noise and gloss may hide
    integrability, and a plane carries no information: such images are refused.

    References
    ----------
    .. [1] P. Belhumeur, D. Kriegman and A. Yuille, "The bas-relief ambiguity", IJCV 35(1), 1999.
    .. [2] A. Yuille and D. Snow, "Shape and albedo from multiple images using integrability",
       CVPR 1997.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.indices((40, 40)) - 19.5
    >>> true = [[0, 0, 1], [0.6, 0, 0.8], [-0.6, 0, 0.8], [0, -0.6, 0.8], [0, 0.6, 0.8]]
    >>> images = cvkern.lambertian((x**2 + y**2) / 60, true)
    >>> light = cvkern.estimate_lights(images)[1]
    >>> print(f"{light[0]:.1f} {light[2]:.1f}")
    0.6 0.8
    """
    equal = check_choice(equal, ("lights", "albedo"), "equal")
    images = check_images(images)
    if images.shape[0] < 4:
        raise ValueError(f"images must be at least 4, got {images.shape[0]}")
    values = np.asarray(images, np.float64)
    shape = values.shape[1:]
    if min(shape) < 2:
        raise ValueError(f"images must have 2 rows and columns at least, got shape {shape}")
    inside = np.ones(shape, bool) if mask is None else host_mask(mask, shape)
    inside &= np.isfinite(values).all(axis=0) & (values.max(axis=0) > 0)
    if not inside.any():
        raise ValueError("images must be finite, and above 0 somewhere in the mask, got none there")
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            lights, normals = _factors(values, inside)
            lights, normals, seen = _integrable(lights, normals, inside)
            own = equal == "lights"
            change = _equal_lights(lights) if own else _equal_albedo(normals[:, seen].T)
            # The matrix transforms normals; its inverse transpose transforms lights.
            normals = np.tensordot(change, normals, 1)
            lights = lights @ np.linalg.inv(change)
    except np.linalg.LinAlgError:
        raise ValueError("images must have three independent lights, got fewer") from None
    rows, columns = np.nonzero(seen)
    outward = normals[0][seen] * (columns - columns.mean()) - normals[1][seen] * (
        rows - rows.mean()
    )
    if outward.sum() < 0:  # hollow
        lights = lights * [-1, -1, 1]
    return lights / np.linalg.norm(lights, axis=1).mean()


def _factors(values: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lights (K, 3) and normals (3, H, W) up to a matrix; shadows are ignored."""
    pixels = values[:, inside]
    step = max(1, pixels.shape[1] // MOST_PIXELS)
    sample = pixels[:, ::step]
    dark = sample < DARK * sample.mean(axis=0)
    filled = sample.copy()
    lights = np.zeros((len(values), 3))
    for _ in range(FILLS):
        strengths, vectors = np.linalg.eigh(filled @ filled.T)
        if not strengths[-3] > 1e-9 * strengths[-1]:
            raise ValueError("images must have three independent lights, got fewer")
        lights = vectors[:, -3:]
        model = lights @ (lights.T @ filled)
        filled[dark] = np.minimum(model, 0)[dark]
    # Solve each pixel from the images in which it is lit.
    dark = (pixels < DARK * pixels.mean(axis=0)).astype(float)
    lit = 1 - dark + 1e-6
    products = np.einsum("ki,kj->kij", lights, lights).reshape(len(lights), 9)
    matrices = (lit.T @ products).reshape(-1, 3, 3)
    right = (lit * pixels).T @ lights
    normals = np.full((3, *inside.shape), np.nan)
    normals[:, inside] = np.linalg.solve(matrices, right[..., None])[..., 0].T
    return lights, normals


def _integrable(
    lights: np.ndarray, normals: np.ndarray, inside: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return lights and normals up to the bas-relief ambiguity, and the mask of the normals.

    With rows a1, a2, a3 of the matrix, ``(a3 x a1) . (b x b_y) = (a3 x a2) . (b x b_x)``.
    """
    least, vectors, seen = np.inf, np.eye(6), inside
    for sigma in SMOOTHED:
        rows, there = _integrability(normals, sigma)
        if len(rows) < 6:
            raise ValueError("mask must have pixels with neighbours, got too few")
        sizes, found = np.linalg.eigh(rows.T @ rows)
        if sizes[0] < least * sizes[1]:
            least, vectors, seen = max(sizes[0], 0.0) / sizes[1], found, there
        if least < CLEAR:
            break
    if not least < MOST_ALIKE:
        raise ValueError(
            "images must show a matt surface whose curvature determines the lights, got noise, "
            "gloss or too flat a surface"
        )
    c1, c2 = vectors[:3, 0], vectors[3:, 0]
    a3 = np.cross(c1, c2)
    a3 /= np.linalg.norm(a3)
    change = np.stack([np.cross(c1, a3), np.cross(c2, a3), a3])
    change[2] *= np.linalg.norm(change[0])
    normals = np.tensordot(change, normals, 1)
    if np.median(normals[2][seen]) < 0:
        normals, change = normals * np.array([1, 1, -1])[:, None, None], change * [[1], [1], [-1]]
    return lights @ np.linalg.inv(change), normals, seen


def _integrability(normals: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the integrability equations of smoothed normals, six terms each, and their mask."""
    from scipy.ndimage import gaussian_filter

    there = np.asarray(np.isfinite(normals).all(axis=0))
    share = gaussian_filter(there.astype(float), sigma) + 1e-30
    normals = np.stack([gaussian_filter(np.where(there, n, 0), sigma) / share for n in normals])
    normals[:, ~there] = np.nan
    across, up = np.gradient(normals, axis=2), -np.gradient(normals, axis=1)
    seen = np.asarray(np.isfinite(across).all(axis=0) & np.isfinite(up).all(axis=0))
    b, bx, by = normals[:, seen].T, across[:, seen].T, up[:, seen].T
    scale = np.linalg.norm(b, axis=1, keepdims=True) ** 2 + 1e-30
    rows = np.hstack([np.cross(b, by), -np.cross(b, bx)]) / scale
    size = np.linalg.norm(rows, axis=1)
    if not len(size):
        return rows, seen
    return rows[size <= 5 * np.median(size) + 1e-30], seen  # leave out edges


def _relief(parameters: np.ndarray) -> np.ndarray:
    """Return the matrix on normals for two slants and the logarithm of a flattening."""
    slant, tilt, scale = parameters
    return np.array([[1, 0, slant], [0, 1, tilt], [0, 0, np.exp(scale)]])


def _equal_lights(lights: np.ndarray) -> np.ndarray:
    """Return the matrix on normals that makes all lights equally strong."""

    def apart(parameters: np.ndarray) -> np.ndarray:
        lengths = np.linalg.norm(lights @ np.linalg.inv(_relief(parameters)), axis=1)
        return lengths / lengths.mean() - 1

    change, least, most, _ = _best(apart)
    if not least > max(LEAST_CHANGE, LEAST_RATIO * most):
        raise ValueError(
            "images must have lights that determine the depth, got lights on a ring about the view "
            "or a surface too flat for its noise: add a light from another slant, or give "
            "equal='albedo' if the albedo is constant"
        )
    return change


def _equal_albedo(normals: np.ndarray) -> np.ndarray:
    """Return the matrix on normals that makes all of them equally long, except for outliers."""
    sample = normals[:: max(1, len(normals) // 4000)]

    def apart(parameters: np.ndarray) -> np.ndarray:
        lengths = np.linalg.norm(sample @ _relief(parameters).T, axis=1)
        return lengths / np.median(lengths) - 1

    change, least, _, left = _best(apart)
    if not left < MOST_LEFT * least:
        raise ValueError(
            "images must have an albedo that determines the depth, got one that varies too much, "
            "or a surface too flat for its noise: give equal='lights' if the lights are equally "
            "strong"
        )
    return change


def _best(apart: Any) -> tuple[np.ndarray, float, float, float]:
    """Return the matrix with the least residuals among several starts, and how sure it is.

    That is the least and the largest root mean square change of the residuals by the parameters,
    and the root mean square of the residuals.
    """
    from scipy.optimize import least_squares

    best, least = None, np.inf
    for slant in (-1.0, 0.0, 1.0):
        for tilt in (-1.0, 0.0, 1.0):
            for scale in (-1.5, 0.0, 1.5):
                start = np.array([slant, tilt, scale])
                found = least_squares(apart, start, loss="soft_l1", f_scale=0.1, max_nfev=60)
                if found.cost < least:
                    best, least = found, found.cost
    if best is None:
        raise np.linalg.LinAlgError("no start has finite residuals")
    sizes = np.linalg.svd(best.jac, compute_uv=False) / math.sqrt(len(best.fun))
    left = float(np.sqrt(np.mean(best.fun**2)))
    return _relief(best.x), float(sizes[-1]), float(sizes[0]), left
