"""Whole photographs as batches of training, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False})


@wp.kernel
def photograph_kernel(
    stride: int,
    first: int,
    last: int,
    images: wp.array2d[wp.uint8],  # (N R, C)
    leap: int,
    seed: int,
    step: wp.array[int],  # (1,)
    # outputs
    view: wp.array[int],  # (1,)
    targets: wp.array2d[float],  # (R, 4)
    views: wp.array[int],  # (R,)
    pixels: wp.array[int],  # (R,)
):
    """Show a pixel of the photograph whose turn it is."""
    for ray in range(first + wp.tid(), last, stride):
        count = images.shape[0] // targets.shape[0]
        turn = wp.int64(step[0]) * wp.int64(leap) + wp.int64(seed)
        chosen = int(turn % wp.int64(count))
        if ray == 0:
            view[0] = chosen
        pixel = chosen * targets.shape[0] + ray
        for k in range(3):
            targets[ray, k] = float(images[pixel, k]) / 255.0
        targets[ray, 3] = 1.0
        if images.shape[1] == 4:
            targets[ray, 3] = float(images[pixel, 3]) / 255.0
        views[ray] = chosen
        pixels[ray] = ray


def photograph(
    images: wp.array,
    leap: int,
    seed: int,
    step: wp.array,
    view: wp.array,
    targets: wp.array,
    views: wp.array,
    pixels: wp.array,
) -> None:
    """Choose photograph (`step` `leap` + `seed`) mod N, and show all of its pixels.

    `images` (N R, 3 or 4) uint8 give `targets` (R, 4): the colour, and the opacity or 1. `view`
    (1,) and `views` (R,) are the photograph, and `pixels` (R,) count its pixels.
    """
    count = views.shape[0]
    launch_each(
        photograph_kernel,
        count,
        8 * count,
        [images, leap, seed, step],
        [view, targets, views, pixels],
    )


@wp.kernel
def leave_out_kernel(
    stride: int,
    first: int,
    last: int,
    masks: wp.array[wp.uint8],  # (N R,)
    view: wp.array[int],  # (1,)
    # outputs
    errors: wp.array[float],  # (R,)
    d_color: wp.array2d[float],  # (R, 3)
    d_opacity: wp.array[float],  # (R,)
    d_learnt: wp.array2d[float],  # (R, 3)
):
    """Clear the gradients of a pixel that does not count."""
    for ray in range(first + wp.tid(), last, stride):
        if int(masks[view[0] * errors.shape[0] + ray]) == 0:
            errors[ray] = -1.0
            d_opacity[ray] = 0.0
            for k in range(3):
                d_color[ray, k] = 0.0
                d_learnt[ray, k] = 0.0


def leave_out(
    masks: wp.array,
    view: wp.array,
    errors: wp.array,
    d_color: wp.array,
    d_opacity: wp.array,
    d_learnt: wp.array,
) -> None:
    """Clear the gradients of R pixels where the mask of a photograph is 0; errors become -1 there.

    `masks` (N R,) uint8 are those of all photographs, and `view` (1,) is the number of this one.
    """
    count = errors.shape[0]
    launch_each(
        leave_out_kernel, count, 4 * count, [masks, view], [errors, d_color, d_opacity, d_learnt]
    )
