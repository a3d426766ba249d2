"""Colours of a photograph's own light: an affine map for each photograph, in Warp.

A photograph has the map c -> c + A c + b of colours, a row (A, b) of 12 numbers, row by row of the
3 x 4 matrix. Composited, the colour C of opacity O becomes C' = C + A C + b O. With gradients G by
C',

    dL/dC = G + A^T G,    dL/dO += <G, b>,    dL/dA = G C^T,    dL/db = O G.

The gradients of a photograph are added as those of :mod:`.embeddings`.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

from . import embeddings

wp.set_module_options({"enable_backward": False})


@wp.kernel
def apply_kernel(
    stride: int,
    first: int,
    last: int,
    color: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    views: wp.array[int],  # (R,)
    table: wp.array2d[float],  # (N, 12)
    # outputs
    shown: wp.array2d[float],  # (R, 3)
):
    """Map the colour of a ray."""
    for ray in range(first + wp.tid(), last, stride):
        view = views[ray]
        r = color[ray, 0]
        g = color[ray, 1]
        b = color[ray, 2]
        for k in range(3):
            own = table[view, 4 * k] * r + table[view, 4 * k + 1] * g + table[view, 4 * k + 2] * b
            shown[ray, k] = color[ray, k] + own + table[view, 4 * k + 3] * opacity[ray]


def apply(
    color: wp.array, opacity: wp.array, views: wp.array, table: wp.array, shown: wp.array
) -> None:
    """Map composited colours (R, 3) by the rows `views` (R,) of `table` (N, 12).

    `shown` (R, 3) may be `color` itself.
    """
    count = opacity.shape[0]
    launch_each(apply_kernel, count, 32 * count, [color, opacity, views, table], [shown])


@wp.kernel
def sum_kernel(
    stride: int,
    first: int,
    last: int,
    d_color: wp.array2d[float],  # (R, 3)
    color: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    views: wp.array[int],  # (R,)
    active: wp.array[int],  # (1,)
    # outputs
    parts: wp.array3d[float],  # (P, N, 12)
):
    """Add the gradients of a photograph's rays in one part."""
    images = parts.shape[1]
    for item in range(first + wp.tid(), last, stride):
        part = item // images
        view = item - part * images
        red = wp.vec4(0.0, 0.0, 0.0, 0.0)
        green = wp.vec4(0.0, 0.0, 0.0, 0.0)
        blue = wp.vec4(0.0, 0.0, 0.0, 0.0)
        for ray in range(part, wp.min(active[0], views.shape[0]), parts.shape[0]):
            if views[ray] == view:
                seen = wp.vec4(color[ray, 0], color[ray, 1], color[ray, 2], opacity[ray])
                red += d_color[ray, 0] * seen
                green += d_color[ray, 1] * seen
                blue += d_color[ray, 2] * seen
        for k in range(4):
            parts[part, view, k] = red[k]
            parts[part, view, 4 + k] = green[k]
            parts[part, view, 8 + k] = blue[k]


@wp.kernel
def back_kernel(
    stride: int,
    first: int,
    last: int,
    views: wp.array[int],  # (R,)
    table: wp.array2d[float],  # (N, 12)
    active: wp.array[int],  # (1,)
    # outputs
    d_color: wp.array2d[float],  # (R, 3): of the mapped colour, then of the colour
    d_opacity: wp.array[float],  # (R,): added to
):
    """Map the gradient of a ray."""
    for ray in range(first + wp.tid(), last, stride):
        if ray < active[0]:
            view = views[ray]
            r = d_color[ray, 0]
            g = d_color[ray, 1]
            b = d_color[ray, 2]
            for k in range(3):
                own = table[view, k] * r + table[view, 4 + k] * g + table[view, 8 + k] * b
                d_color[ray, k] = d_color[ray, k] + own
            shift = table[view, 3] * r + table[view, 7] * g + table[view, 11] * b
            d_opacity[ray] = d_opacity[ray] + shift


def backward(
    color: wp.array,
    opacity: wp.array,
    views: wp.array,
    table: wp.array,
    active: wp.array,
    d_color: wp.array,
    d_opacity: wp.array,
    parts: wp.array,
    d_table: wp.array,
) -> None:
    """Turn gradients by mapped colours, `d_color` (R, 3), into those by colours, in place.

    The other arguments are those of :func:`apply`, of which the first `active` (1,) rays count.
    `d_opacity` (R,) is added to, `d_table` (N, 12) is filled; `parts` (P, N, 12) is working memory.
    """
    count, images = opacity.shape[0], table.shape[0]
    inputs = [d_color, color, opacity, views, active]
    launch_each(sum_kernel, parts.shape[0] * images, images * count, inputs, [parts])
    embeddings.sum_parts(parts, d_table)
    launch_each(back_kernel, count, 32 * count, [views, table, active], [d_color, d_opacity])
