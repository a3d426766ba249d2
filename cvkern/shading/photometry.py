"""Photometric stereo: normals and albedo from images under several lights."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_numbers, check_choice, check_flag, check_image, check_positive
from cvkern._notices import may_look, warn
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.shading import MOST_LIGHTS, Photometric, Weighing
from cvkern.shading.integration import integrate_normals
from cvkern.shading.masks import kernel_mask

METHODS = tuple(code.name.lower() for code in Photometric)
# Windows of ranks, as shares: darker and brighter values are ignored.
WINDOWS = {
    Photometric.TRIMMED: ((0.3, 0.9),),
    Photometric.CONSENSUS: tuple((a, b) for a in (0.0, 0.3, 0.6) for b in (0.8, 1.0)),
}
# Rules that divide each image by the strength of its light, so that brightness tells shadows and
# highlights from the rest under strong and weak lights alike.
EVEN = Photometric.TRIMMED, Photometric.CONSENSUS
SWEEPS = {Photometric.L1: 20, Photometric.SPARSE_BAYES: 50, Photometric.CONSENSUS: 3}
FLATTEST = 1e-3  # least singular value of light directions, as a share of the largest
ROUNDS = 8  # alternations of depth and normals under near lights


class PhotometricStereo(NamedTuple):
    """Normals and albedo of a surface."""

    normals: Any
    """Unit normals (x right, y up, z towards the camera), (H, W, 3) float32; NaN where unknown."""
    albedo: Any
    """Length of the solution: the image under a frontal light of strength 1, (H, W) float32."""
    residual: Any
    """Root mean square of image minus model, (H, W) float32, in values of the images."""


def photometric_stereo(
    images: Any,
    lights: Any,
    *,
    method: str = "consensus",
    mask: Any = None,
    saturation: float | None = None,
    near: bool = False,
) -> PhotometricStereo:
    """Find the normals of a surface from images under several lights.

    Parameters
    ----------
    images : array of shape (K, H, W)
        At least three images, linear in light, from one viewpoint. Any real dtype; computed in
        float32. A sequence of K NumPy images also works.
    lights : array of shape (K, 3), or (K, 4) with `near`
        Vectors towards distant lights, in the axes of normals: x right, y up, z towards the camera.
        The length of a vector is the strength of its light. With `near`, the first three columns
        are positions, and an optional fourth column has the strengths.
    method : {'consensus', 'least_squares', 'trimmed', 'l1', 'sparse_bayes'}
        `consensus`, the default, averages robust solutions of six windows of brightness, weighted
        by how well each determines the normal. `least_squares` suits a matt surface without
        shadows. `trimmed` uses the values of ranks 30 % to 90 % of each pixel. `l1` minimises the
        sum of absolute residuals. `sparse_bayes` assumes large errors in few images. `consensus`
        and `trimmed` first divide each image by the strength of its light; the others give images
        under strong lights a larger weight. With three images, all give their one solution.
    mask : array of shape (H, W), optional
        Pixels of the surface are not 0. By default all pixels. :func:`capture` records bool and
        uint8 masks on a GPU.
    saturation : float, optional
        Values of at least this are ignored.
    near : bool, default False
        Lights have positions in pixels: pixel (r, c) is at x = c, y = -r, and the mean depth of
        each connected part is z = 0. The function alternates 8 times between normals and their
        integration to depth.

    Returns
    -------
    PhotometricStereo
        Named tuple of `normals` (H, W, 3), `albedo` and `residual` (H, W), float32, of the same
        library as `images`. Normals are NaN, and the others 0, outside the mask, where fewer than
        three values are usable, and where all values are 0 or less. Values that are not finite are
        ignored, except with `least_squares` and no `saturation`: there they make the pixel NaN.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `near` is not a bool.
    ValueError
        If there are fewer than three images, lights lie in one plane or are not finite, a shape
        does not match, `mask` is 0 everywhere, or `method` is unknown.

    See Also
    --------
    lights_from_sphere : Lights from images of a chrome sphere.
    estimate_lights : Lights from the images themselves.
    integrate_normals : Depth from the normals.

    Notes
    -----
    These axes are the one exception to the rules of the library: y points up.

    `least_squares` gives the same bits with both kernel sets. The other methods compute in float64,
    and agree up to the rounding of their float32 results. On a GPU, all except `sparse_bayes` add
    in float32 and then correct the solution by its residuals: normals agree to 2e-5 at 99 % of the
    pixels. They agree to 5e-3 where there are hardly more images than unknowns, and with `l1`,
    whose weights of small residuals jump.

    References
    ----------
    .. [1] R. J. Woodham, "Photometric method for determining surface orientation from multiple
       images", Optical Engineering 19(1), 1980.
    .. [2] S. Ikehata, D. Wipf, Y. Matsushita and K. Aizawa, "Robust photometric stereo using
       sparse regression", CVPR 2012.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> lights = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.6, 0, 0.8]])
    >>> normals = np.full((2, 2, 3), [0.0, 0.28, 0.96])
    >>> images = cvkern.lambertian(normals, lights, albedo=0.5)
    >>> found = cvkern.photometric_stereo(images, lights)
    >>> found.normals[0, 0].round(2), found.albedo[0, 0].round(2)
    (array([0.  , 0.28, 0.96], dtype=float32), np.float32(0.5))
    """
    code = Photometric[check_choice(method, METHODS, "method").upper()]
    near = check_flag(near, "near")
    images = check_images(images)
    given = check_lamps(lights, images.shape[0], near)
    limit = np.inf if saturation is None else check_positive(saturation, "saturation")
    shape = tuple(images.shape[1:])
    rt = runtime(images)
    inside = kernel_mask(rt, mask, shape)
    seen = rt.adopt(images)
    found = PhotometricStereo(rt.empty((*shape, 3)), rt.empty(shape), rt.empty(shape))
    outputs = [rt.adopt(a) for a in found]
    photometry = rt.shading.photometry
    if code is Photometric.LEAST_SQUARES and limit == np.inf and not near:
        lamps = rt.constant(given.astype(np.float32))
        inverse = rt.constant(np.linalg.pinv(given[:, :3]).astype(np.float32))
        photometry.solve(seen, inverse, lamps, inside, *outputs)
        return PhotometricStereo(*(rt.release(a) for a in found))
    if images.shape[0] == 3:
        # No value is left over to judge the others by: those that are dark have to take part.
        code = Photometric.LEAST_SQUARES
    given = scaled(given, near, code in EVEN)
    lamps = rt.constant(given.astype(np.float32))
    scales = rt.constant(given[:, 4].astype(np.float32))
    ranks = rt.scratch("shading.ranks", tuple(images.shape), np.uint16)
    photometry.rank(seen, scales, inside, float(limit), ranks)
    windows = rt.constant(np.array(WINDOWS.get(code, ((0, 1),)), np.float32))
    weighing = Weighing(int(code), SWEEPS.get(code, 0))
    depth = rt.scratch("shading.far", (0, 1), np.float32)
    for n in range(ROUNDS if near else 1):
        if near:
            own = None if mask is None else inside
            depth = _near_depth(rt, outputs[0] if n else None, own, shape)
        photometry.weigh(seen, ranks, lamps, depth, windows, weighing, *outputs)
    if limit < np.inf and may_look(rt):
        least = float(np.fmin.reduce(rt.to_numpy(seen), axis=None, initial=np.inf))
        if limit <= least < np.inf:
            warn(f"no normal was found: all values are at least {least:.4g}, and saturation is "
                 f"{limit:.4g}")  # fmt: skip
    return PhotometricStereo(*(rt.release(a) for a in found))


def _near_depth(rt: Runtime, normals: Any, inside: Any, shape: tuple[int, int]) -> Any:
    """Return depth for kernels: integrated from the normals, or a plane if there are none yet."""
    if normals is None:
        return rt.send("shading.near", np.zeros(shape, np.float32))
    mask = None if inside is None else rt.to_numpy(inside)
    depth = integrate_normals(rt.to_numpy(normals), mask=mask)
    return rt.send("shading.near", np.asarray(depth, np.float32))


def scaled(lamps: np.ndarray, near: bool, even: bool) -> np.ndarray:
    """Return lamps with a scale for the values of their images, (K, 5).

    The scales are 1, or if images count evenly, one over the strengths, which become 1.
    """
    strengths = lamps[:, 3] if near else np.linalg.norm(lamps[:, :3], axis=1)
    scales = 1 / np.where(strengths > 0, strengths, 1) if even else np.ones(len(lamps))
    lamps = lamps.copy()
    lamps[:, 3 if near else slice(3)] *= scales if near else scales[:, None]
    return np.hstack([lamps, scales[:, None]])


def check_images(images: Any) -> Any:
    """Return images under several lights as one array (K, H, W)."""
    images = check_lit(images)
    if not 3 <= images.shape[0] <= MOST_LIGHTS:
        raise ValueError(f"images must be 3 to {MOST_LIGHTS}, got {images.shape[0]}")
    return images


def check_lit(images: Any) -> Any:
    """Return grey images as one array (K, H, W)."""
    images = check_image(images, ndim=(2, 3, 4), name="images")
    shape = tuple(images.shape)
    if len(shape) != 3:
        hint = ": take the mean of the channels of colour images" if len(shape) == 4 else ""
        raise ValueError(f"images must have shape (K, H, W), got {shape}{hint}")
    return images


def check_lamps(lights: Any, count: int, near: bool) -> np.ndarray:
    """Return lights as (K, 4) float64: a vector or a position, and a strength."""
    given = as_numbers(lights, "lights")
    wide = (3, 4) if near else (3,)
    if given.ndim != 2 or given.shape[0] != count or given.shape[1] not in wide:
        want = f"({count}, 3)" + (f" or ({count}, 4)" if near else "")
        raise ValueError(f"lights must have shape {want}, got {given.shape}")
    if not np.isfinite(given).all():
        raise ValueError("lights must be finite, got others")
    vectors = given[:, :3] / np.maximum(np.linalg.norm(given[:, :3], axis=1), 1e-300)[:, None]
    values = np.linalg.svd(vectors, compute_uv=False)
    if not near and values[2] < FLATTEST * values[0]:
        raise ValueError("lights must not lie in one plane through the origin, got such lights")
    return np.hstack([given, np.ones((count, 1))]) if given.shape[1] == 3 else given
