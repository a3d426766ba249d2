"""Calls that compile the kernels of dense stereo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern import stereo
from cvkern.app.warmup import pictures

# Functions that run on the host, or on kernels that the calls below compile.
NO_KERNELS = ("reconstruct_pair", "reprojection_matrix")


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function, and for every dtype with its own kernels."""
    byte, real, color = pictures()
    q = np.eye(4)
    yield "disparity_to_depth", partial(stereo.disparity_to_depth, real, 1.0, 1.0)
    yield "points_from_disparity", partial(stereo.points_from_disparity, real, q)
    yield "point_cloud", partial(stereo.point_cloud, real, q, byte)
    for cost in ("sad", "ssd", "birchfield_tomasi", "zncc", "census", "census_symmetric"):
        for image in (byte, real):
            for window in (1, 3, 17):  # costs of uint8, uint16 and float32
                pair = partial(stereo.stereo_cost, image, image, (0, 4), cost=cost, window=window)
                yield "stereo_cost", pair
    deep = byte[..., None].astype(np.int32) + np.arange(5)
    for costs in (deep.astype(np.uint8), deep.astype(np.uint16)):
        for paths in (4, 8, 16):
            sums = partial(stereo.aggregate_semi_global, costs, 5, 50, paths=paths)
            yield "aggregate_semi_global", sums
        yield "winner_take_all", partial(stereo.winner_take_all, costs)
    yield "winner_take_all", partial(stereo.winner_take_all, deep.astype(np.float32))
    yield "left_right_check", partial(stereo.left_right_check, real, real)
    yield "remove_speckles", partial(stereo.remove_speckles, real)
    yield "fill_disparity", partial(stereo.fill_disparity, real)
    yield "guided_median", partial(stereo.guided_median, real, byte)
    # Kernels are compiled for vectors of 64 disparities, and of 32 for fewer.
    for image, axis in ((np.uint8(color), -1), (byte, None), (real, None)):
        match = partial(stereo.stereo_match, image, image, channel_axis=axis)
        for paths in (8, 4):
            for span in ((0, 36), (0, 8)):
                yield "stereo_match", partial(match, span, method="semi-global", paths=paths)
        yield "stereo_match", partial(match, (0, 8), method="window")
