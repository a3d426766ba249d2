"""Robust fits to matches, in Warp."""

import warp as wp

from cvkern.kernels.codes.geometry import GROUP
from cvkern.kernels.warp._launch import launch, launch_each

from . import _robust_choice as choice
from . import _robust_cpu as cpu
from . import _robust_cuda as cuda

# Work of a hypothesis and of a match in a step, in the units by which slabs are cut.
_HYPOTHESIS, _STEP = 256, 64


def propose(
    matches: wp.array,
    spans: wp.array,
    squares: wp.array,
    planes: wp.array,
    pairs: wp.array,
    kind: int,
    seed: int,
    first: int,
    models: wp.array,
    costs: wp.array,
) -> None:
    """Score the best hypothesis of each group on all matches of a pair.

    `matches` are x0, y0, x1, y1, (4, M) float32; `spans` (P, 2) first and number of those of a
    pair, `squares` (P,) float32 of its threshold, `planes` (P, 9) float64 of a homography for a
    model that starts from one, `pairs` (A,) int32 those to work on. Hypothesis `first` + 64 g is
    the first one of group g. `models` are (A, G, 9) float32, `costs` (A, G) int32, `NO_COST` where
    all samples of a group are degenerate.
    """
    inputs = [matches, spans, squares, planes, pairs, kind, seed, first]
    count = costs.shape[0] * costs.shape[1]
    if costs.device.is_cuda:
        launch(cuda.propose, cuda.threads(count), inputs, [models, costs], cuda.BLOCK)
    else:
        elements = count * GROUP * _HYPOTHESIS
        launch_each(cpu.propose, count, elements, inputs, [models, costs])


def choose(models: wp.array, costs: wp.array, rows: wp.array, chosen: wp.array) -> None:
    """Copy the models of least (cost, group) of each row, in that order, (R, L, 9) float64."""
    elements = chosen.shape[0] * costs.shape[1] * chosen.shape[1]
    launch_each(choice.choose, chosen.shape[0], elements, [models, costs, rows], [chosen])


def refine(
    matches: wp.array,
    spans: wp.array,
    squares: wp.array,
    pairs: wp.array,
    kind: int,
    schedule: wp.array,
    models: wp.array,
    costs: wp.array,
    supports: wp.array,
) -> None:
    """Improve models (A, L, 9) float64 of `pairs` (A,) by steps of least squares over inliers.

    Step s takes the matches whose squared residual r is below c = `schedule[s]` times the square of
    the threshold, with the weight (1 - r / c)^2. `costs` and `supports` (A, L) int32 are those
    of the result.
    """
    inputs = [matches, spans, squares, pairs, kind, schedule]
    count = costs.shape[0] * costs.shape[1]
    outputs = [models, costs, supports]
    if costs.device.is_cuda:
        launch(cuda.refine, cuda.threads(count), inputs, outputs, cuda.BLOCK)
    else:
        mean = matches.shape[1] // max(spans.shape[0], 1)
        launch_each(cpu.refine, count, count * mean * _STEP, inputs, outputs)


def mark(
    matches: wp.array,
    spans: wp.array,
    squares: wp.array,
    kind: int,
    models: wp.array,
    inliers: wp.array,
) -> None:
    """Tell which matches are closer to the model (P, 9) of their pair than the threshold."""
    inputs = [matches, spans, squares, kind, models]
    if inliers.device.is_cuda:
        launch(cuda.mark, cuda.threads(spans.shape[0]), inputs, [inliers], cuda.BLOCK)
    else:
        launch_each(cpu.mark, spans.shape[0], matches.shape[1], inputs, [inliers])
