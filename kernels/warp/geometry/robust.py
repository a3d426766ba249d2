"""Robust fits to matches, in Warp.

The Taichi set has the method. _robust.h has samples, solvers, residuals and steps, for either
device. On the CPU a thread takes a slab of groups of hypotheses, or of models (_robust_cpu.py); on
CUDA a warp takes one of them (_robust_cuda.py).
"""

import warp as wp

from cvkern.kernels.codes.geometry import GROUP, Draw, Given, Model
from cvkern.kernels.warp._launch import launch, launch_each

from . import _robust_choice as choice
from . import _robust_cpu as cpu
from . import _robust_cuda as cuda

# Work of a hypothesis, and of a match in all steps, in the units by which slabs are cut: of maps
# and of other models. Hundreds of hypotheses of one map take less than waking another thread.
_HYPOTHESIS, _STEPS = (64, 256), (16, 64)


def propose(given: Given, pairs: wp.array, draw: Draw, models: wp.array, costs: wp.array) -> None:
    """Score the best hypothesis of each group on all matches of a pair.

    `pairs` (A,) int32 are those to work on. Hypothesis `draw.first` + 64 g is the first one of
    group g. `models` are (A, G, 9) float32, `costs` (A, G) int32, `NO_COST` where all samples of a
    group are degenerate.
    """
    count = costs.shape[0] * costs.shape[1]
    if costs.device.is_cuda:
        inputs = [*given, pairs, wp.vec3i(*draw)]
        launch(cuda.propose, cuda.threads(count), inputs, [models, costs], cuda.BLOCK)
    else:
        inputs, kernel = [*given, pairs, draw.seed, draw.first], cpu.kernels(draw.kind).propose
        work = count * GROUP * _HYPOTHESIS[draw.kind >= Model.FUNDAMENTAL]
        launch_each(kernel, count, work, inputs, [models, costs])


def choose(models: wp.array, costs: wp.array, rows: wp.array, chosen: wp.array) -> None:
    """Copy the models of least (cost, group) of each row, in that order, (R, L, 9) float64."""
    elements = chosen.shape[0] * costs.shape[1] * chosen.shape[1]
    launch_each(choice.choose, chosen.shape[0], elements, [models, costs, rows], [chosen])


def refine(
    given: Given, pairs: wp.array, kind: int, schedule: wp.array, models: wp.array, scores: wp.array
) -> None:
    """Improve models (A, L, 9) float64 of `pairs` (A,) by steps of least squares over inliers.

    Step s takes the matches whose squared residual is below `schedule[s]` times the square of the
    threshold; of maps all alike, else with weights that fall to 0 there. `scores` (A, L, 2) int32
    are the cost and the number of inliers of the result.
    """
    count = scores.shape[0] * scores.shape[1]
    if scores.device.is_cuda:
        inputs = [*given, pairs, kind, schedule]
        launch(cuda.refine, cuda.threads(count), inputs, [models, scores], cuda.BLOCK)
    else:
        mean = given.matches.shape[1] // max(given.spans.shape[0], 1)
        inputs, kernel = [*given, pairs, schedule], cpu.kernels(kind).refine
        work = count * mean * _STEPS[kind >= Model.FUNDAMENTAL]
        launch_each(kernel, count, work, inputs, [models, scores])


def mark(given: Given, kind: int, models: wp.array, inliers: wp.array) -> None:
    """Tell which matches are closer to the model (P, 9) of their pair than the threshold."""
    count = given.spans.shape[0]
    if inliers.device.is_cuda:
        inputs = [*given, kind, models]
        launch(cuda.mark, cuda.threads(count), inputs, [inliers], cuda.BLOCK)
    else:
        inputs, kernel = [*given, models], cpu.kernels(kind).mark
        launch_each(kernel, count, given.matches.shape[1], inputs, [inliers])
