"""Pictures of point clouds, in Warp."""

import warp as wp

from . import _clouds_blocks as blocks
from ._launch import launch


def splat(
    points: wp.array,
    pose: wp.array,
    focal: float,
    cx: float,
    cy: float,
    size: float,
    keys: wp.array,
) -> None:
    """Leave in `keys` the nearest point of each sample, or FAR; one thread a point.

    A point is a square of `size` samples in the view of the camera at the origin, and in that of
    the camera at `pose` by as much larger as it is nearer. Points behind either are not seen.
    """
    flat = (keys.size,)
    launch(blocks.clear, flat, [], [keys.reshape(flat)])
    launch(blocks.splat, points.shape[0], [points, pose, focal, cx, cy, size], [keys])


def shade(
    keys: wp.array, colors: wp.array, background: wp.array, samples: int, image: wp.array
) -> None:
    """Average the colours of the samples of each pixel; one thread a pixel."""
    pixels = image.shape[0] * image.shape[1]
    launch(blocks.shade, pixels, [keys, colors, background, samples], [image])
