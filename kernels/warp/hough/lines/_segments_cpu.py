"""Which line a point belongs to, on the CPU: 64 points at a time, as vector code."""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

POINTS = 64  # at a time

_CLAIM = """
    #pragma clang fp contract(off)
    const int number = points.shape[0], count = cosine.shape[0], begin = block * SIZE;
    const int size = number - begin < SIZE ? number - begin : SIZE;
    float y[SIZE], x[SIZE];
    int code[SIZE], past[SIZE], label[SIZE];
    for (int i = 0; i < SIZE; ++i) {
        const int point = begin + (i < size ? i : 0);
        y[i] = points.data[2 * point];
        x[i] = points.data[2 * point + 1];
        code[i] = codes.data[point];
        past[i] = after.data[point];
        label[i] = count;
    }
    for (int k = 0; k < count; ++k) {
        const float c = cosine.data[k], s = sine.data[k], r = rho.data[k];
        const int direction = directions.data[k];
        #pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < SIZE; ++i) {
            const float away = __builtin_fabsf((x[i] * c + y[i] * s) - r);
            const int turn = (code[i] - direction) & (HALF_TURN - 1);
            const int angle = turn < HALF_TURN - turn ? turn : HALF_TURN - turn;
            const bool on = (away <= distance) & (angle <= tolerance) & (k > past[i]);
            const int mine = on ? k : count;
            label[i] = mine < label[i] ? mine : label[i];
        }
    }
    for (int i = 0; i < size; ++i) labels.data[begin + i] = label[i];
"""


@wp.func_native(_CLAIM.replace("SIZE", str(POINTS)).replace("HALF_TURN", str(DIRECTIONS // 2)))
def claim_block(
    block: int,
    points: wp.array2d[float],
    codes: wp.array[int],
    after: wp.array[int],
    cosine: wp.array[float],
    sine: wp.array[float],
    rho: wp.array[float],
    directions: wp.array[int],
    distance: float,
    tolerance: int,
    labels: wp.array[int],
): ...


@wp.kernel
def claim(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    after: wp.array[int],  # (N,)
    cosine: wp.array[float],  # (K,)
    sine: wp.array[float],
    rho: wp.array[float],
    directions: wp.array[int],
    distance: float,
    tolerance: int,
    # outputs
    labels: wp.array[int],  # (N,)
):
    # Rows of a slab are blocks of points.
    for block in range(first, last):
        claim_block(
            block, points, codes, after, cosine, sine, rho, directions, distance, tolerance, labels
        )
