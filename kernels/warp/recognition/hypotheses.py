"""Evidence of patches for objects at given places, in Warp.

A patch within the frame of an object is evidence for it: the sum of the weights of its words for
the cell of the frame in which it lies. For patches of each size, those of
the level whose scale is nearest count.
"""

import warp as wp

from cvkern.kernels.codes.recognition import Frame, Patches, Space
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._zeros import clear

from ._space import below, factor_of, first_from, scaled

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 128  # threads of a mode, or of a pair of modes, on CUDA
PER_ROW = wp.constant(16)  # those among them that share a row of patches
WORK = 1024  # steps for a mode, roughly: for the number of threads only


@wp.struct
class Scene:
    """Patches, and how they are weighed."""

    places: wp.array2d[int]  # (N, 3)
    rows: wp.array2d[int]  # (R, 3)
    levels: wp.array2d[int]  # (L, 3)
    matches: wp.array2d[int]  # (N, M)
    weights: wp.array2d[int]  # (K, cells)
    factors: wp.array[int]
    lowest: int
    layers: wp.array2d[int]  # (B, 6)
    box_height: int
    box_width: int


def _scene(patches: Patches, weights: wp.array, space: Space, frame: Frame) -> Scene:
    scene = Scene()
    scene.places, scene.rows, scene.levels, scene.matches = patches
    scene.weights, scene.factors, scene.lowest = weights, space.factors, space.lowest
    scene.layers, scene.box_height, scene.box_width = frame
    return scene


def weigh_evidence(
    patches: Patches,
    weights: wp.array,
    space: Space,
    frame: Frame,
    modes: wp.array,
    evidence: wp.array,
) -> None:
    """Add up the evidence of all patches for each of T modes.

    `weights` (K, cells) are those of each word, cells row by row.
    """
    lanes = LANES if evidence.device.is_cuda else 1
    count = modes.shape[0]
    clear(evidence)
    inputs = [lanes, _scene(patches, weights, space, frame), modes]
    launch_each(_weigh, count * lanes, count * WORK, inputs, [evidence])


def weigh_overlaps(
    patches: Patches,
    weights: wp.array,
    space: Space,
    frame: Frame,
    modes: wp.array,
    shared: wp.array,
) -> None:
    """Add up the evidence for mode i of the patches in the box of mode j, (T, T).

    The box is that of the mode's scale.
    """
    lanes = LANES if shared.device.is_cuda else 1
    count = shared.size
    clear(shared)
    inputs = [lanes, _scene(patches, weights, space, frame), modes]
    launch_each(_weigh_pairs, count * lanes, count * WORK, inputs, [shared])


@wp.func
def cell_at(layers: wp.array2d[int], b: int, dy: int, dx: int, factor: int) -> int:
    """Return the cell of a layer at a distance from the middle, or -1 outside of its frame."""
    half_height = layers[b, 0]
    half_width = layers[b, 1]
    y = below(dy, factor) + half_height
    x = below(dx, factor) + half_width
    if y < 0 or x < 0 or y >= 2 * half_height or x >= 2 * half_width:
        return -1
    row = y * layers[b, 2] // (2 * half_height)
    return layers[b, 5] + row * layers[b, 3] + x * layers[b, 3] // (2 * half_width)


@wp.func
def level_of(levels: wp.array2d[int], scale: int) -> int:
    """Return the level whose scale is nearest, the first of several."""
    found = int(0)
    for level in range(1, levels.shape[0]):
        if wp.abs(levels[level, 0] - scale) < wp.abs(levels[found, 0] - scale):
            found = level
    return found


@wp.func
def first_row(rows: wp.array2d[int], begin: int, end: int, place: int) -> int:
    """Return the first row of patches of a part of them that is not above a place."""
    low = begin
    high = end
    while low < high:
        middle = (low + high) // 2
        if rows[middle, 0] < place:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def evidence_of(
    scene: Scene, modes: wp.array2d[int], t: int, by: int, lane: int, lanes: int
) -> int:
    """Return a lane's part of the evidence for mode t.

    If `by` is not -1, it is that of the patches that are in the box of that mode too. Lanes share
    the rows of patches, and 16 of them the patches of a row.
    """
    total = int(0)
    y = modes[t, 0]
    x = modes[t, 1]
    other = by
    if by < 0:
        other = t
    wide = factor_of(scene.factors, scene.lowest, modes[other, 2])
    high = scaled(scene.box_height, wide)
    broad = scaled(scene.box_width, wide)
    step = wp.min(lanes, PER_ROW)
    for b in range(scene.layers.shape[0]):
        level = level_of(scene.levels, modes[t, 2] + scene.layers[b, 4])
        factor = factor_of(scene.factors, scene.lowest, scene.levels[level, 0])
        height = scaled(scene.layers[b, 0], factor) + 1
        width = scaled(scene.layers[b, 1], factor) + 1
        top = y - height
        bottom = y + height
        left = x - width
        right = x + width
        if by >= 0:
            top = wp.max(top, modes[other, 0] - high)
            bottom = wp.min(bottom, modes[other, 0] + high)
            left = wp.max(left, modes[other, 1] - broad)
            right = wp.min(right, modes[other, 1] + broad)
        last = scene.levels[level, 2]
        row = first_row(scene.rows, scene.levels[level, 1], last, top) + lane // step
        while row < last and scene.rows[row, 0] <= bottom:
            dy = scene.rows[row, 0] - y
            end = scene.rows[row, 2]
            i = first_from(scene.places, scene.rows[row, 1], end, left) + lane % step
            while i < end and scene.places[i, 1] <= right:
                cell = cell_at(scene.layers, b, dy, scene.places[i, 1] - x, factor)
                if cell >= 0:
                    for m in range(scene.matches.shape[1]):
                        word = scene.matches[i, m]
                        if word >= 0:
                            total += scene.weights[word, cell]
                i += step
            row += lanes // step
    return total


@wp.kernel
def _weigh(
    stride: int,
    first: int,
    last: int,
    lanes: int,
    scene: Scene,
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    evidence: wp.array[int],
):
    for item in range(first + wp.tid(), last, stride):
        t = item // lanes
        total = evidence_of(scene, modes, t, -1, item - t * lanes, lanes)
        if total != 0:
            wp.atomic_add(evidence, t, total)


@wp.kernel
def _weigh_pairs(
    stride: int,
    first: int,
    last: int,
    lanes: int,
    scene: Scene,
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    shared: wp.array2d[int],  # (T, T)
):
    for item in range(first + wp.tid(), last, stride):
        pair = item // lanes
        i = pair // shared.shape[1]
        j = pair - i * shared.shape[1]
        total = evidence_of(scene, modes, i, j, item - pair * lanes, lanes)
        if total != 0:
            wp.atomic_add(shared, i, j, total)
