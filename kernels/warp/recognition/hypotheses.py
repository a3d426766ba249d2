"""Evidence of patches for objects at given places, in Warp.

A patch within the frame of an object is evidence for it: the sum of the weights of its words for
the cell of the frame in which it lies. For patches of each size, those of
the level whose scale is nearest count.
"""

import warp as wp

from cvkern.kernels.codes.recognition import Frame, Patches, Space
from cvkern.kernels.warp._launch import launch_each

from ._space import below, factor_of, scaled

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

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
    """Add up the evidence of all patches for each of T modes; a thread a mode.

    `weights` (K, cells) are those of each word, cells row by row.
    """
    count = modes.shape[0]
    scene = _scene(patches, weights, space, frame)
    launch_each(_weigh, count, count * WORK, [scene, modes], [evidence])


def weigh_overlaps(
    patches: Patches,
    weights: wp.array,
    space: Space,
    frame: Frame,
    modes: wp.array,
    shared: wp.array,
) -> None:
    """Add up the evidence for mode i of the patches in the box of mode j, (T, T); a thread a pair.

    The box is that of the mode's scale.
    """
    count = shared.size
    scene = _scene(patches, weights, space, frame)
    launch_each(_weigh_pairs, count, count * WORK, [scene, modes], [shared])


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
def evidence_of(scene: Scene, modes: wp.array2d[int], t: int, by: int) -> int:
    """Return the evidence for mode t of the patches in the box of mode `by` too, if not -1."""
    total = int(0)
    y = modes[t, 0]
    x = modes[t, 1]
    other = by
    if by < 0:
        other = t
    wide = factor_of(scene.factors, scene.lowest, modes[other, 2])
    high = scaled(scene.box_height, wide)
    broad = scaled(scene.box_width, wide)
    for b in range(scene.layers.shape[0]):
        level = level_of(scene.levels, modes[t, 2] + scene.layers[b, 4])
        factor = factor_of(scene.factors, scene.lowest, scene.levels[level, 0])
        height = scaled(scene.layers[b, 0], factor) + 1
        width = scaled(scene.layers[b, 1], factor) + 1
        for row in range(scene.levels[level, 1], scene.levels[level, 2]):
            dy = scene.rows[row, 0] - y
            if wp.abs(dy) <= height and (
                by < 0 or wp.abs(scene.rows[row, 0] - modes[other, 0]) <= high
            ):
                for i in range(scene.rows[row, 1], scene.rows[row, 2]):
                    dx = scene.places[i, 1] - x
                    if wp.abs(dx) <= width and (
                        by < 0 or wp.abs(scene.places[i, 1] - modes[other, 1]) <= broad
                    ):
                        cell = cell_at(scene.layers, b, dy, dx, factor)
                        if cell >= 0:
                            for m in range(scene.matches.shape[1]):
                                word = scene.matches[i, m]
                                if word >= 0:
                                    total += scene.weights[word, cell]
    return total


@wp.kernel
def _weigh(
    stride: int,
    first: int,
    last: int,
    scene: Scene,
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    evidence: wp.array[int],
):
    for t in range(first + wp.tid(), last, stride):
        evidence[t] = evidence_of(scene, modes, t, -1)


@wp.kernel
def _weigh_pairs(
    stride: int,
    first: int,
    last: int,
    scene: Scene,
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    shared: wp.array2d[int],  # (T, T)
):
    for item in range(first + wp.tid(), last, stride):
        i = item // shared.shape[1]
        j = item - i * shared.shape[1]
        shared[i, j] = evidence_of(scene, modes, i, j)
