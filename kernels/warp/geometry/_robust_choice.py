"""The groups of hypotheses with the least costs, in Warp; of equal costs, the first ones.

One thread takes a pair of images.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def choose(
    stride: int,
    begin: int,
    end: int,
    models: wp.array3d[float],
    costs: wp.array2d[int],
    rows: wp.array[int],
    # output
    chosen: wp.array3d[wp.float64],
):
    for i in range(begin + wp.tid(), end, stride):
        row = rows[i]
        last = wp.int64(-1)  # cost and group of the one before, as one number
        for rank in range(chosen.shape[1]):
            least = wp.int64(0x7FFFFFFFFFFFFFFF)
            for group in range(costs.shape[1]):
                key = (wp.int64(costs[row, group]) << wp.int64(32)) + wp.int64(group)
                if key > last and key < least:
                    least = key
            found = int(least & wp.int64(0x7FFFFFFF))
            for k in range(9):
                value = wp.float64(0.0)
                if found < costs.shape[1]:
                    value = wp.float64(models[row, found, k])
                chosen[i, rank, k] = value
            last = least
