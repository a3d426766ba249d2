"""Shape from shading: normals and depth from one image of a matt surface."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import FLOAT32_MAX, as_numbers, check_image, check_integer
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.shading import integration
from cvkern.shading.masks import host_mask
from cvkern.shading.rendering import check_albedo

SOFT = 2.0  # standard deviation in pixels of the smoothing that gives the direction of a border
LIKELY = 0.2  # largest difference between the brightness of a silhouette and of a border pixel
INWARD = 3  # pixels from a border pixel inwards to the one that its brightness is compared with
MARGIN = 9.0  # largest distance in pixels of a mask's border from the silhouette around it
CUT = 0.8  # brightness above that of a silhouette from which a border pixel belongs to a cut
BRIGHTEST = 1.1  # median brightness, where 1 faces the light, above which the albedo is wrong
FLAT = 0.05  # least z of a normal; steeper slopes are limited to that of this z
FIRST, INNER = 300, 10  # sweeps before the first integration of depth, and between two of them
TOLERANCE = 1e-3
# Steps of an integration between sweeps. Bodies take 4 and photographs up to 33; masks of scattered
# pixels, whose thin bridges no coarse level shows, took 130 each time. The next round continues
# from the result of this one, and the last round has no such limit.
MOST_STEPS = 40


class ShapeFromShading(NamedTuple):
    """Normals and depth of a surface from one image."""

    normals: Any
    """Unit normals (x right, y up, z towards the camera), (H, W, 3) float32; NaN outside."""
    depth: Any
    """Depth in pixels, growing away from the camera, of mean 0, (H, W) float32; NaN outside."""


def shape_from_shading(
    image: Any,
    light: Any,
    *,
    mask: Any = None,
    boundary: Any = None,
    albedo: Any = 1.0,
    rounds: int = 60,
) -> ShapeFromShading:
    """Find the shape of a matt surface from one image under a known light.

    Parameters
    ----------
    image : array of shape (H, W)
        Image of any real dtype, linear in light.
    light : array of shape (3,)
        Vector towards the light: x right, y up, z towards the camera. Its length is the strength.
    mask : array of shape (H, W), optional
        Pixels of the surface are not 0. By default the image above 0, with holes filled.
    boundary : array of shape (H, W, 3), optional
        Known normals, NaN elsewhere. By default the normals of the silhouette, which is the mask's
        border within the image; they are perpendicular to the view. The mask may be some pixels too
        wide or too narrow. A border pixel that is brighter than a silhouette by more than 0.2, and
        from which brightness does not rise inwards as it does near one, belongs to a cut and stays
        free.
    albedo : float or array of shape (H, W), default 1.0
        Share of the light that the surface reflects; it must be known.
    rounds : int, default 60
        Number of integrations of depth that guide the normals.

    Returns
    -------
    ShapeFromShading
        Named tuple of `normals` (H, W, 3) and `depth` (H, W), float32, of the same library as
        `image`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `rounds` is not an integer.
    ValueError
        If a shape does not match, the light does not come from the camera's side, an array is not
        finite where it must be, most of the image is brighter than `albedo` and `light` allow,
        `mask` is 0 everywhere, or no normal is known at its border. One image alone cannot
        distinguish hills from hollows.

    See Also
    --------
    photometric_stereo : Normals from three images or more, without these assumptions.

    Notes
    -----
    These axes are the one exception to the rules of the library: y points up.

    The brightness of a pixel confines its normal to a cone. Sweeps smooth the normals on their
    cones [1]_, starting from the known normals at the border. In turns with the sweeps, the normals
    are integrated to depth, and the normals of the depth guide them. This makes them integrable.
    The method fails for an unknown varying albedo, cast shadows, light from several sides, and
    hollow objects, because their silhouette is the same as that of a hill.

    References
    ----------
    .. [1] P. L. Worthington and E. R. Hancock, "New constraints on data-closeness and needle map
       consistency for shape-from-shading", IEEE PAMI 21(12), 1999.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.indices((21, 21)) - 10
    >>> height = np.sqrt(np.maximum(81.0 - x**2 - y**2, 0)) / 9  # a sphere's brightness
    >>> found = cvkern.shape_from_shading(height, [0, 0, 1])
    >>> found.normals[10, 5, ::2].round(1)
    array([-0.6,  0.8], dtype=float32)
    """
    image = check_image(image)
    shape = tuple(image.shape)
    vector = as_numbers(light, "light")
    if vector.shape != (3,) or not (np.abs(vector) <= FLOAT32_MAX).all():
        raise ValueError(f"light must be three finite numbers, got {vector.tolist()}")
    strength = float(np.linalg.norm(vector))
    if not vector[2] > 0:
        raise ValueError(f"light must have z > 0, from the camera's side, got {vector.tolist()}")
    check_albedo(albedo, shape)
    rounds = check_integer(rounds, "rounds", 0, 10000)
    refuse_capture("shape_from_shading")
    rt = runtime(image)
    toward = vector / strength
    values = rt.to_numpy(rt.adopt(image)) / (np.asarray(albedo, np.float64) * strength + 1e-30)
    inside = _inside(mask, values, shape)
    if not np.isfinite(values[inside]).all():
        raise ValueError("image must be finite within the mask, got others")
    usual = float(np.median(values[inside]))
    if usual > BRIGHTEST:
        raise ValueError(
            "image must be at most albedo times the length of light, got a median of "
            f"{usual:.3g} times that: give the albedo in the units of the image"
        )
    shown = np.where(inside, np.clip(values, 0, 1), 0)
    if boundary is None:
        if min(shape) < 2:
            raise ValueError(f"boundary must be given for images of shape {shape}, got None")
        known, fixed = _silhouette(inside, shown, toward)
    else:
        known = as_numbers(check_image(boundary, ndim=(3,), name="boundary"), "boundary")
        if known.shape != (*shape, 3):
            raise ValueError(f"boundary must have shape {(*shape, 3)}, got {known.shape}")
        fixed = np.isfinite(known).all(axis=-1) & inside
        known = np.where(fixed[..., None], known, 0.0)
        known = known / np.maximum(np.abs(known).max(axis=-1, keepdims=True), 1e-30)
        known = known / np.maximum(np.linalg.norm(known, axis=-1, keepdims=True), 1e-30)
    if not fixed.any():
        raise ValueError(
            "boundary must have at least one normal, got none: no part of the mask's border is as "
            "bright as a silhouette"
        )
    normals = _spread(np.where(fixed[..., None], known, 0), fixed, inside)
    state = inside.astype(np.uint8) + (inside & np.logical_not(fixed))
    return _recover(rt, normals, shown, state, toward, rounds)


def _recover(
    rt: Runtime, normals: np.ndarray, shown: np.ndarray, state: np.ndarray, toward: np.ndarray,
    rounds: int,
) -> ShapeFromShading:  # fmt: skip
    """Return the shape after sweeps from the given normals, in turns with integration."""
    shape = shown.shape
    fields = [rt.scratch(f"sfs.{n}", (*shape, 3)) for n in range(2)]
    rt.write(fields[0], normals.astype(np.float32))
    image = rt.send("sfs.image", shown.astype(np.float32))
    states = rt.send("sfs.state", state)
    guide = rt.send("sfs.guide", np.full((*shape, 3), np.nan, np.float32))
    light = (float(toward[0]), float(toward[1]), float(toward[2]))
    sweep = rt.shading.recovery.sweep

    def sweeps(count: int) -> None:
        for _ in range(count):
            sweep(fields[0], image, states, guide, light, fields[1])
            fields.reverse()

    sweeps(FIRST)
    # The differences on both sides of a pixel have equal weights, times its z.
    equations = rt.shading.integration.equations
    inside = rt.scratch("relief.inside", shape, np.uint8)
    slope = rt.scratch("relief.slope", (3, *shape))
    cut = rt.scratch("relief.cut", (1,), np.int32)
    shares = rt.send("relief.shares", np.full((2, *shape), 0.5, np.float32))
    depth = rt.scratch("sfs.depth", shape)
    parts = rt.send("relief.parts", (state > 0).astype(np.int32))
    solver = None
    for turn in range(rounds + 1):
        equations.slopes(fields[0], states, FLAT, inside, slope, cut)
        solver = solver or integration.Solver(rt, inside, shape)
        equations.join(inside, slope, shares, solver.weights, solver.rises)
        between = 0 < turn < rounds
        solver.solve(TOLERANCE, MOST_STEPS if between else integration.MOST_STEPS)
        own = rt.to_numpy(solver.z)[state > 0].mean()
        equations.finish(solver.z, parts, rt.send("relief.means", np.array([0.0, own])), depth)
        if turn < rounds:
            rt.shading.rendering.normals(depth, guide)
            sweeps(INNER)
    found = rt.to_numpy(fields[0]).copy()
    found[state == 0] = np.nan
    return ShapeFromShading(rt.give(found), rt.give(rt.to_numpy(depth).copy()))


def _inside(mask: Any, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the mask of the surface: the given one, or the image above 0 with holes filled."""
    from scipy.ndimage import binary_fill_holes

    return host_mask(binary_fill_holes(values > 0) if mask is None else mask, shape)


def _silhouette(
    inside: np.ndarray, shown: np.ndarray, light: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return normals at the mask's border within the image, and the mask of silhouette pixels.

    The normals face away from the surface; the brightness gives their angle to the camera. A border
    pixel belongs to a silhouette if it is about as bright as one, or darker, as a background is, or
    if it lies inside of one.
    """
    from scipy.ndimage import binary_erosion, gaussian_filter

    soft = gaussian_filter(inside.astype(np.float64), SOFT, mode="nearest")
    down, across = np.gradient(soft)
    away = np.stack([-across, down, 0 * across], axis=-1)
    away /= np.linalg.norm(away, axis=-1, keepdims=True) + 1e-30
    border = inside & np.logical_not(binary_erosion(inside, border_value=1))
    flat = away @ light
    base = np.maximum(flat, 0)
    border &= (shown < base + LIKELY) | _inner(inside, away, shown, base)
    # The angle t from the camera's axis has flat sin t + light_z cos t = shown.
    size, middle = np.hypot(flat, light[2]), np.arctan2(flat, light[2])
    apart = np.arccos(np.clip(shown / np.maximum(size, 1e-9), -1, 1))
    one, other = middle + apart, middle - apart
    nearer = np.where(np.abs(one - np.pi / 2) < np.abs(other - np.pi / 2), one, other)
    angle = np.where(shown > 0, np.clip(nearer, np.pi / 4, np.pi / 2), np.pi / 2)
    known = np.sin(angle)[..., None] * away
    known[..., 2] = np.cos(angle)
    return known, border


def _inner(inside: np.ndarray, away: np.ndarray, shown: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Return where the brightness rises inwards as it does near a silhouette.

    At the distance d from a silhouette, a surface is brighter than there by about sqrt(d). So the
    squares of this at two pixels, one behind the other, give the distance of the outer one.
    """
    height, width = inside.shape
    y, x = np.indices(inside.shape)
    y = np.round(y + INWARD * away[..., 1]).astype(int).clip(0, height - 1)
    x = np.round(x - INWARD * away[..., 0]).astype(int).clip(0, width - 1)
    outer, inner = shown - base, np.where(inside[y, x], shown[y, x] - base, 0)
    rises = np.maximum(inner, 0) ** 2 > (1 + INWARD / MARGIN) * outer**2
    return rises & (outer < CUT)


def _spread(known: np.ndarray, fixed: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Interpolate normals between the known ones by harmonic functions of x and y."""
    import scipy.sparse as sparse
    from scipy.sparse.linalg import spsolve

    numbers = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    pairs = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        both = inside[a] & inside[b]
        pairs.append(np.stack([numbers[a][both], numbers[b][both]]))
    first, second = np.concatenate(pairs, axis=1)
    count = int(inside.sum())
    joined = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    joined = (joined + joined.T).tocsr()
    free = np.logical_not(fixed[inside])
    held = fixed[inside]
    degrees = sparse.diags(np.asarray(joined.sum(axis=1)).ravel() + 1e-9)
    matrix = (degrees - joined).tocsr()
    values = known[inside]
    if free.any():
        right = -(matrix[free][:, held] @ values[held, :2])
        values[free, :2] = np.asarray(spsolve(matrix[free][:, free].tocsc(), right))
    flat = (values[:, :2] ** 2).sum(axis=1)
    values[free, 2] = np.sqrt(np.maximum(1 - flat, 0))[free]
    normals = np.zeros(known.shape)
    normals[inside] = values
    return normals
