"""Depth from normals."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_choice, check_image, check_integer, check_number, check_positive
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.kernels.codes.shading import CHUNKS
from cvkern.shading.masks import kernel_mask
from cvkern.shading.rectangles import MOST_SIDE, solve_rectangle

METHODS = ("poisson", "bilateral")
FLATTEST = 0.01  # least z of a unit normal; steeper slopes are limited to that of this z
COARSEST = 16  # largest number of pixels of the coarsest level, unless it is a line
SETTLED = 8  # forward and backward sweeps that solve the coarsest level
OFTEN = 4  # steps between checks of convergence on a GPU, where the host waits for them
MOST_STEPS = 400
# A residual of this share of the first is below what float32 shows of depths. Where little is left
# to change, as in the last rounds of a method, rounding errors are all that is left of residuals.
ROUNDING = 1e-9
LEAST_GAIN = 1e-4  # relative decrease of the energy below which the weights are final


def integrate_normals(
    normals: Any,
    mask: Any = None,
    *,
    method: str = "poisson",
    sharpness: float = 2.0,
    tolerance: float = 1e-05,
    iterations: int = 100,
) -> Any:
    """Integrate normals to depth.

    Parameters
    ----------
    normals : array of shape (H, W, 3)
        (x right, y up, z towards the camera), of any length. Any real dtype. Normals that are not
        finite or face away from the camera count as outside.
    mask : array of shape (H, W), optional
        Pixels of the surface are not 0. By default all pixels with a valid normal.
    method : {'poisson', 'bilateral'}, default 'poisson'
        `poisson` assumes a continuous surface within the mask. `bilateral` allows jumps of depth.
    sharpness : float, default 2.0
        For `bilateral`: the factor k of the weights in the notes, per square pixel. A larger one
        makes sharper decisions between the two sides of a pixel.
    tolerance : float, default 1e-05
        Relative error of the depth in the energy norm of the equations, in (0, 1).
    iterations : int, default 100
        For `bilateral`: largest number of updates of the weights. It stops earlier when the energy
        falls by less than a ten-thousandth.

    Returns
    -------
    array of shape (H, W), float32
        Depth in pixels, growing away from the camera, NaN outside. Each connected part (along rows
        and columns) has an unknown offset, and its mean is set to 0. The array is of the same
        library and on the same device as `normals`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or a number is not one.
    ValueError
        If a shape does not match, `mask` is 0 at all valid normals, `method` is unknown, or a
        number is out of range.

    See Also
    --------
    photometric_stereo : Normals from images.
    mesh_from_depth : A mesh of triangles from the depth.
    normals_from_depth : The inverse.

    Notes
    -----
    `poisson` solves ``z_b - z_a = (p_a + p_b) / 2`` for neighbours a and b by least squares. There
    p is the slope less a twelfth of its second derivative, which makes the mean of two the rise
    between them. `bilateral` has one equation on each side of a pixel, ``n_z (z_b - z_a) = n_x``.
    It repeatedly gives the side that differs less a larger weight,
    ``1 / (1 + exp(-k (d_-^2 - d_+^2)))`` [1]_. The equations are solved in float64 by conjugate
    gradients, preconditioned by a multigrid cycle in float32.

    Slopes steeper than 100 count as 100.

    References
    ----------
    .. [1] X. Cao, H. Santo, B. Shi, F. Okura and Y. Matsushita, "Bilateral normal integration",
       ECCV 2022.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> normals = np.full((2, 3, 3), [-0.6, 0, 0.8])  # a plane that faces left
    >>> cvkern.integrate_normals(normals).round(3)
    array([[ 0.75,  0.  , -0.75],
           [ 0.75,  0.  , -0.75]], dtype=float32)
    """
    normals = check_image(normals, ndim=(3,), name="normals")
    if normals.shape[2] != 3:
        raise ValueError(f"normals must have shape (H, W, 3), got {tuple(normals.shape)}")
    method = check_choice(method, METHODS, "method")
    sharpness = check_positive(sharpness, "sharpness")
    tolerance = check_number(tolerance, "tolerance")
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance must be in (0, 1), got {tolerance:g}")
    iterations = check_integer(iterations, "iterations", 1, 10000)
    shape = tuple(normals.shape[:2])
    refuse_capture("integrate_normals")
    rt = runtime(normals)
    given = kernel_mask(rt, mask, shape, empty=True)
    inside, slope = (
        rt.scratch("relief.inside", shape, np.uint8),
        rt.scratch("relief.slope", (3, *shape)),
    )
    kernels, cut = rt.shading.integration.equations, rt.scratch("relief.cut", (1,), np.int32)
    rt.clear(cut)
    kernels.slopes(rt.adopt(normals), given, FLATTEST, inside, slope, cut)
    if method == "poisson":
        adjusted = rt.scratch("relief.adjusted", (2, *shape))
        kernels.adjust(inside, slope, adjusted)
        slope = adjusted
        if not rt.to_numpy(cut)[0] and max(shape) <= MOST_SIDE:
            result = rt.empty(shape)
            solve_rectangle(rt, slope, rt.adopt(result))
            return rt.release(result)
    there = rt.to_numpy(inside) != 0
    if not there.any():
        raise ValueError("mask must not be 0 at all valid normals, got nothing to integrate")
    solver = Solver(rt, inside, shape)
    kernels.join(inside, slope, solver.none, solver.weights, solver.rises)
    solver.solve(tolerance)
    if method == "bilateral":
        shares = rt.scratch("relief.shares", (2, *shape))
        before = np.inf
        for _ in range(iterations):
            kernels.sides(solver.z, inside, slope, sharpness, shares)
            kernels.join(inside, slope, shares, solver.weights, solver.rises)
            energy = solver.misfit(slope, shares)
            if energy >= (1 - LEAST_GAIN) * before:
                break
            before = energy
            solver.solve(max(tolerance, 1e-3))
    parts, means = _parts(rt, solver.z, there)
    result = rt.empty(shape)
    kernels.finish(solver.z, parts, means, rt.adopt(result))
    return rt.release(result)


def _parts(rt: Runtime, z: Any, there: np.ndarray) -> tuple[Any, Any]:
    """Return labels of connected parts from 1 on, 0 outside, and the mean depth of each part."""
    from scipy.ndimage import label

    numbers, count = label(there)  # pyright: ignore[reportGeneralTypeIssues]
    values = rt.to_numpy(z)
    sizes = np.bincount(numbers.ravel(), minlength=count + 1)
    means = np.bincount(numbers.ravel(), values.ravel(), count + 1) / np.maximum(sizes, 1)
    parts = rt.send("relief.parts", np.ascontiguousarray(numbers, np.int32))
    return parts, rt.send("relief.means", means)


class Solver:
    """Equations on the edges between pixels, and their multigrid levels."""

    def __init__(self, rt: Runtime, inside: Any, shape: tuple[int, int]):
        self.rt = rt
        self.z, self.r, self.p, self.q = (
            rt.scratch(f"relief.{name}", shape, np.float64) for name in "zrpq"
        )
        rt.clear(self.z)
        self.largest = 0.0  # the largest residual so far, at first of the whole right side
        # Dot products: residual and preconditioned residual; direction and its image; the former
        # value of the first.
        self.sums = rt.scratch("relief.sums", (3,), np.float64)
        self.partial = rt.scratch("relief.partial", (CHUNKS,), np.float64)
        self.rises = rt.scratch("relief.rises", (2, *shape))
        self.none = rt.scratch("relief.none", (0, 1, 1))
        self.levels = [(rt.scratch("relief.weights", (2, *shape)), inside, *self._fields(0, shape))]
        # Each level halves a side above 2, so there are at most 16 of them.
        while np.prod(shape) > COARSEST and max(shape) > 2:
            shape = (shape[0] + 1) // 2, (shape[1] + 1) // 2
            n = len(self.levels)
            self.levels.append(
                (
                    rt.scratch(f"relief.weights{n}", (2, *shape)),
                    rt.scratch(f"relief.inside{n}", shape, np.uint8),
                    *self._fields(n, shape),
                )
            )
        self.weights = self.levels[0][0]

    def misfit(self, slope: Any, shares: Any) -> float:
        """Return the energy of z for the given weights of the sides of each pixel."""
        rows = self.rt.scratch("relief.rows", (self.z.shape[0],), np.float64)
        self.rt.shading.integration.equations.weigh_misfit(
            self.z, self.levels[0][1], slope, shares, rows
        )
        return float(self.rt.to_numpy(rows).sum())

    def _fields(self, n: int, shape: tuple[int, int]) -> tuple[Any, Any]:
        return self.rt.scratch(f"relief.b{n}", shape), self.rt.scratch(f"relief.x{n}", shape)

    def solve(self, tolerance: float, most: int = MOST_STEPS) -> int:
        """Iterate from z to the solution; return the number of steps, `most` at most."""
        kernels, weights = self.rt.shading.integration.multigrid, self.weights
        pull = self.rt.shading.integration.equations.pull
        for fine, coarse in zip(self.levels, self.levels[1:], strict=False):
            kernels.coarsen(fine[0], fine[1], coarse[0], coarse[1])
        self.rt.write(self.sums, np.zeros(3))
        pull(weights, self.rises, self.z, 1.0, self.r)
        first, often = None, 1 if self.rt.device == "cpu" else OFTEN
        for step in range(most):
            smoothed = self._cycle()
            kernels.weigh_rest(self.r, smoothed, self.partial, self.sums)
            if step % often == 0:
                left = float(self.rt.to_numpy(self.sums)[0])
                first = left if first is None else first
                self.largest = max(self.largest, first)
                if not left > max(tolerance**2 * first, ROUNDING**2 * self.largest):
                    return step
            kernels.turn(smoothed, self.sums, self.p)
            pull(weights, self.none, self.p, -1.0, self.q)
            kernels.weigh_step(self.p, self.q, self.partial, self.sums)
            kernels.advance(self.p, self.q, self.sums, self.z, self.r)
        return most

    def _cycle(self) -> Any:
        """Apply one multigrid cycle to the residual."""
        kernels, levels = self.rt.shading.integration.multigrid, self.levels
        kernels.begin(self.r, levels[0][2], levels[0][3])
        for n, (weights, _, b, x) in enumerate(levels[:-1]):
            if n:
                self.rt.clear(x)
            kernels.smooth(weights, b, 0, x)
            kernels.smooth(weights, b, 1, x)
            kernels.restrict(weights, b, x, levels[n + 1][2])
        weights, _, b, x = levels[-1]
        kernels.settle(weights, b, SETTLED, x)
        for n in range(len(levels) - 2, -1, -1):
            weights, _, b, x = levels[n]
            kernels.prolong(levels[n + 1][3], x)
            kernels.smooth(weights, b, 1, x)
            kernels.smooth(weights, b, 0, x)
        return levels[0][3]
