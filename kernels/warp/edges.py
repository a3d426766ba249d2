"""Thinning, hysteresis and sub-pixel edge points, in Warp.

On the CPU, thinning runs over lanes and hysteresis is a flood fill in each slab of rows; on CUDA a
thread thins a strip of a column, and hysteresis is a union-find over all pixels at once.
"""

from typing import Any

import warp as wp

from . import _edges_blocks as blocks
from . import _edges_lanes as lanes
from . import _edges_points as edge_points
from ._lanes import f32_lanes, padded, u8_lanes, unpad, vectors
from ._launch import launch, launch_slabs, scratch, slabs


def thin_sobel(
    src: wp.array, border: int, cval: float, norm: int, low: float, high: float, states: wp.array
) -> None:
    """Sobel, suppression of all but maxima, and both thresholds, of a uint8 image."""
    if src.device.is_cuda:
        launch(
            blocks.thin_sobel,
            _strips(src),
            [src, _in_words(src, states), border, cval, norm, low, high],
            [states],
        )
        return
    wide_src = padded(src, "thin.src")
    _thin_slabs(
        lanes.thin_sobel,
        [vectors(wide_src, u8_lanes), wide_src.shape[1], src.shape[1], border, cval],
        [norm, low, high],
        states,
    )


def thin(
    dy: wp.array, dx: wp.array, norm: int, rule: int, low: float, high: float, states: wp.array
) -> None:
    """Suppression of all but maxima of a gradient, and both thresholds."""
    if dy.device.is_cuda:
        launch(
            blocks.thin,
            _strips(dy),
            [dy, dx, _in_words(states), norm, rule, low, high],
            [states],
        )
        return
    wide_dy, wide_dx = padded(dy, "thin.dy"), padded(dx, "thin.dx")
    _thin_slabs(
        lanes.thin,
        [vectors(wide_dy, f32_lanes), vectors(wide_dx, f32_lanes), wide_dy.shape[1], dy.shape[1]],
        [norm, rule, low, high],
        states,
    )


def hysteresis(states: wp.array, mask: wp.array) -> None:
    """Keep strong pixels, and the weak ones connected with them."""
    height, width = states.shape
    size = height * width
    states, mask = states.reshape((size,)), mask.reshape((size,))
    words, mask_words = _words(states, mask)
    if states.device.is_cuda:
        parents = scratch("hysteresis.parents", (size + 1,), wp.int32, states.device)
        launch(blocks.plant, -(-size // 8), [states, words], [parents, mask, mask_words])
        launch(blocks.merge, size, [states, width], [parents])
        launch(blocks.select, size, [states, parents], [mask])
        return
    mask.zero_()
    count = slabs(height, size)
    # A pixel is pushed once: the stack of a slab needs no more room than the slab has pixels.
    stack = scratch("hysteresis.stack", (size,), wp.int32, states.device)
    launch_slabs(
        lanes.flood_slab,
        height,
        count,
        [states, words, width, stack],
        [mask],
    )
    if count > 1:
        launch(
            lanes.flood_seams,
            1,
            [count, states, width, stack],
            [mask],
        )


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


def _strips(image: wp.array) -> tuple[int, int]:
    return -(-image.shape[0] // blocks.ROWS), -(-image.shape[1] // blocks.QUAD)


def _in_words(*images: wp.array) -> bool:
    """Tell whether every row of the images falls into aligned words of four bytes."""
    return all(a.shape[1] % 4 == 0 and a.ptr % 4 == 0 for a in images)


def _words(*flats: wp.array) -> list[wp.array]:
    """View bytes eight at a time, as far as they go; none if they are not aligned."""
    count = flats[0].size // 8 if all(a.ptr % 8 == 0 for a in flats) else 0
    return [wp.array(ptr=a.ptr, dtype=wp.uint64, shape=(count,), device=a.device) for a in flats]


def _thin_slabs(
    kernel: wp.Kernel, image: list[Any], parameters: list[Any], states: wp.array
) -> None:
    """Run a thinning kernel of the CPU with its scratch lines."""
    height = states.shape[0]
    wide = padded(states, "thin.states")
    count = slabs(height, states.size)
    shape = (count, lanes.LINES, wide.shape[1] + 2)
    lines = scratch("thin.lines", shape, wp.float32, states.device)
    launch_slabs(
        kernel,
        height,
        count,
        [*image, *parameters, lines, vectors(lines, f32_lanes)],
        [vectors(wide, u8_lanes)],
    )
    unpad(wide, states)
