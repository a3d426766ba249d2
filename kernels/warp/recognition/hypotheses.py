"""Evidence of patches for objects at given places, in Warp.

A patch within the frame of an object is evidence for it: the sum of the weights of its words for
the cell of the frame in which it lies. For patches of each size, those of
the level whose scale is nearest count.
"""

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Frame, Patches, Space
from cvkern.kernels.warp._launch import launch, launch_each, scratch
from cvkern.kernels.warp._zeros import clear

from ._space import below, factor_of, first_from, scaled

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 128  # threads of a mode, or of a pair of modes, on CUDA
PER_ROW = wp.constant(16)  # those among them that share a row of patches
WORK = 1024  # steps for a mode, roughly: for the number of threads only
BLOCKS = 1024  # blocks on CUDA that share the pairs of modes
CLIMBED = wp.constant(codes.CLIMBED)
FINE = wp.constant(codes.FINE)


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
    """Add up the evidence of all patches for each of T modes; modes of density 0 have none.

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

    The box is that of the mode's scale. Modes of density 0 have no evidence, and share none.
    """
    lanes = LANES if shared.device.is_cuda else 1
    count = shared.size * lanes
    clear(shared)
    inputs = [lanes, _scene(patches, weights, space, frame), modes]
    if shared.device.is_cuda:
        threads = min(count, BLOCKS * LANES)
        launch(_weigh_pairs, threads, [threads, 0, count, *inputs], [shared], LANES)
        return
    launch_each(_weigh_pairs, count, count * WORK, inputs, [shared])


def climb_modes(
    patches: Patches,
    weights: wp.array,
    space: Space,
    frame: Frame,
    step: int,
    least: int,
    modes: wp.array,
    evidence: wp.array,
    moved: wp.array,
    found: wp.array,
) -> None:
    """Move each of T modes to the place with most evidence among its own and eight round it.

    Those are `step` pixels of the model away; the first wins a tie: the mode's own, then those to
    the left and right, then those above, then those below. A mode whose `evidence` (T,) is below
    `least` gets density 0. `found` (T,) is the evidence there.
    """
    count = modes.shape[0]
    around = scratch("recognition.around", (count, codes.CLIMBED), wp.int32, found.device)
    lanes = LANES if found.device.is_cuda else 1
    clear(around)
    inputs = [lanes, _scene(patches, weights, space, frame), step, least, modes, evidence]
    number = count * codes.CLIMBED
    launch_each(_weigh_around, number * lanes, number * WORK, inputs, [around])
    inputs = [step, least, space.factors, space.lowest, modes, evidence, around]
    launch_each(_climb, count, count, inputs, [moved, found])


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
def place_of(modes: wp.array2d[int], t: int) -> wp.vec3i:
    """Return row, column and scale of a mode."""
    return wp.vec3i(modes[t, 0], modes[t, 1], modes[t, 2])


@wp.func
def evidence_of(
    scene: Scene, mode: wp.vec3i, bounded: bool, by: wp.vec3i, lane: int, lanes: int
) -> int:
    """Return a lane's part of the evidence for a mode.

    If it is bounded, it is that of the patches that are in the box of another mode too. Lanes share
    the rows of patches, and 16 of them the patches of a row.
    """
    total = int(0)
    y = mode[0]
    x = mode[1]
    wide = factor_of(scene.factors, scene.lowest, by[2])
    high = scaled(scene.box_height, wide)
    broad = scaled(scene.box_width, wide)
    step = wp.min(lanes, PER_ROW)
    for b in range(scene.layers.shape[0]):
        level = level_of(scene.levels, mode[2] + scene.layers[b, 4])
        factor = factor_of(scene.factors, scene.lowest, scene.levels[level, 0])
        height = scaled(scene.layers[b, 0], factor) + 1
        width = scaled(scene.layers[b, 1], factor) + 1
        top = y - height
        bottom = y + height
        left = x - width
        right = x + width
        if bounded:
            top = wp.max(top, by[0] - high)
            bottom = wp.min(bottom, by[0] + high)
            left = wp.max(left, by[1] - broad)
            right = wp.min(right, by[1] + broad)
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
        if modes[t, 3] > 0:
            mode = place_of(modes, t)
            total = evidence_of(scene, mode, False, mode, item - t * lanes, lanes)
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
        if modes[i, 3] > 0 and modes[j, 3] > 0:
            lane = item - pair * lanes
            mode = place_of(modes, i)
            total = evidence_of(scene, mode, True, place_of(modes, j), lane, lanes)
            if total != 0:
                wp.atomic_add(shared, i, j, total)


@wp.func
def beside(mode: wp.vec3i, k: int, step: int, factors: wp.array[int], lowest: int) -> wp.vec3i:
    """Return the k-th of nine places that a mode climbs among: 0, then before, then behind."""
    apart = scaled(FINE * step, factor_of(factors, lowest, mode[2]))
    down = k // 3
    along = k - 3 * down
    if down == 2:
        down = -1
    if along == 2:
        along = -1
    return wp.vec3i(mode[0] - down * apart, mode[1] - along * apart, mode[2])


@wp.kernel
def _weigh_around(
    stride: int,
    first: int,
    last: int,
    lanes: int,
    scene: Scene,
    step: int,
    least: int,
    modes: wp.array2d[int],  # (T, 4)
    evidence: wp.array[int],
    # outputs
    around: wp.array2d[int],  # (T, 9)
):
    for item in range(first + wp.tid(), last, stride):
        place = item // lanes
        t = place // CLIMBED
        k = place - t * CLIMBED
        if k > 0 and modes[t, 3] > 0 and evidence[t] >= least:
            mode = beside(place_of(modes, t), k, step, scene.factors, scene.lowest)
            total = evidence_of(scene, mode, False, mode, item - place * lanes, lanes)
            if total != 0:
                wp.atomic_add(around, t, k, total)


@wp.kernel
def _climb(
    stride: int,
    first: int,
    last: int,
    step: int,
    least: int,
    factors: wp.array[int],
    lowest: int,
    modes: wp.array2d[int],  # (T, 4)
    evidence: wp.array[int],
    around: wp.array2d[int],  # (T, 9)
    # outputs
    moved: wp.array2d[int],  # (T, 4)
    found: wp.array[int],
):
    for t in range(first + wp.tid(), last, stride):
        top = evidence[t]
        best = int(0)
        density = modes[t, 3]
        if top < least:
            density = int(0)
        if density > 0:
            for k in range(1, CLIMBED):
                if around[t, k] > top:
                    top = around[t, k]
                    best = k
        place = beside(place_of(modes, t), best, step, factors, lowest)
        for k in range(3):
            moved[t, k] = place[k]
        moved[t, 3] = density
        found[t] = top
