"""Sub-pixel edge points, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch

from . import _subpixel as edge_points


def count_edges(dy: wp.array, dx: wp.array, mask: wp.array, counts: wp.array) -> None:
    """Count the sub-pixel edge points of each row; one thread a row."""
    launch(edge_points.count_edges, mask.shape[0], [dy, dx, mask], [counts])


def gather_edges(
    dy: wp.array,
    dx: wp.array,
    mask: wp.array,
    starts: wp.array,
    points: wp.array,
    orientation: wp.array,
    strength: wp.array,
) -> None:
    """Locate the edge points of each row, from its place in `starts` on; one thread a row."""
    launch(
        edge_points.gather_edges,
        mask.shape[0],
        [dy, dx, mask, starts],
        [points, orientation, strength],
    )
