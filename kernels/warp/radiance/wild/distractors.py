"""Weights of rays by how likely they are to show the scene, in Warp.

A pixel of a photograph shows the scene, with the probability p of its patch, or something else, a
distractor. In the scene, the errors of the three channels are normal with the variance v; the
colours of distractors are uniform. With the mean squared error e of the channels, a ray shows the
scene with the probability

    w = 1 / (1 + exp(-z)),    z = log(p / (1 - p)) - 3/2 e / v - 3/2 log(2 pi v),

which weighs its gradients. v is the mean of e weighted by w, and p is the mean of w over the patch
and its neighbours: expectation maximisation for a mixture of two distributions [Bishop, "Pattern
recognition and machine learning", 2006, section 9.3]. One thread takes a ray, or a patch.
"""

import math

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import launch, launch_each
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._structs import Patches

wp.set_module_options({"enable_backward": False})

UNIT = wp.constant(256.0)  # units of a share, in sums
FULL = wp.constant(2.0 * math.pi)


@wp.kernel
def weigh_kernel(
    stride: int,
    first: int,
    last: int,
    errors: wp.array[float],  # (R,)
    views: wp.array[int],  # (R,)
    pixels: wp.array[int],  # (R,)
    active: wp.array[int],  # (1,)
    patches: Patches,
    # outputs
    d_color: wp.array2d[float],  # (R, 3): multiplied by the weight
    d_opacity: wp.array[float],  # (R,)
    d_learnt: wp.array2d[float],  # (R, 3)
    moments: wp.array2d[float],  # (R, 3): weighted error, weight, 0
):
    """Weigh the gradients of a ray."""
    v = patches.noise[0]
    for ray in range(first + wp.tid(), last, stride):
        if ray < active[0]:
            row = pixels[ray] // patches.width
            column = pixels[ray] - row * patches.width
            p = patches.share[views[ray], row // patches.side, column // patches.side]
            e = errors[ray]
            z = wp.log(p / (1.0 - p)) - 1.5 * (e / v + wp.log(FULL * v))
            w = 1.0 / (1.0 + wp.exp(-z))
            for k in range(3):
                d_color[ray, k] = w * d_color[ray, k]
                d_learnt[ray, k] = w * d_learnt[ray, k]
            d_opacity[ray] = w * d_opacity[ray]
            moments[ray, 0] = w * e
            moments[ray, 1] = w
            moments[ray, 2] = 0.0


@wp.kernel
def count_kernel(
    stride: int,
    first: int,
    last: int,
    moments: wp.array2d[float],  # (R, 3)
    views: wp.array[int],  # (R,)
    pixels: wp.array[int],  # (R,)
    active: wp.array[int],  # (1,)
    # outputs
    patches: Patches,
):
    """Add the weight of a ray to those of its patch."""
    for ray in range(first + wp.tid(), last, stride):
        if ray < active[0]:
            row = pixels[ray] // patches.width
            i = row // patches.side
            j = (pixels[ray] - row * patches.width) // patches.side
            wp.atomic_add(patches.sums, views[ray], i, j, int(UNIT * moments[ray, 1] + 0.5))
            wp.atomic_add(patches.counts, views[ray], i, j, 1)


def weigh(
    errors: wp.array,
    views: wp.array,
    pixels: wp.array,
    active: wp.array,
    patches: codes.Patches,
    d_color: wp.array,
    d_opacity: wp.array,
    d_learnt: wp.array,
    moments: wp.array,
) -> None:
    """Multiply gradients of rays by their weights, and count these in their patches.

    `errors` (R,) are the mean squared errors of the first `active` (1,) rays, through the `pixels`
    (R,) of the photographs `views` (R,). `d_color` (R, 3), `d_opacity` (R,) and `d_learnt` (R, 3)
    are multiplied, and `moments` (R, 3) filled with the weighted error, the weight, and 0.
    """
    count, given = errors.shape[0], struct_of(Patches, patches)
    inputs = [errors, views, pixels, active, given]
    launch_each(weigh_kernel, count, 64 * count, inputs, [d_color, d_opacity, d_learnt, moments])
    inputs = [moments, views, pixels, active]
    if d_color.device.is_cuda:
        launch_each(count_kernel, count, count, inputs, [given])
    else:  # one thread, because sums of a CPU's threads are not atomic
        launch(count_kernel, 1, [1, 0, count, *inputs], [given])


@wp.kernel
def noise_kernel(
    moments: wp.array[float],  # (3,): sums; set to 0
    rate: float,
    least: float,
    # outputs
    noise: wp.array[float],  # (1,)
):
    """Move the noise towards that of a batch."""
    if moments[1] > 0.0:
        found = moments[0] / moments[1]
        noise[0] = wp.max(least, noise[0] + rate * (found - noise[0]))
    for k in range(3):
        moments[k] = 0.0


def learn_noise(moments: wp.array, rate: float, least: float, noise: wp.array) -> None:
    """Move `noise` (1,) by the share `rate` towards the weighted error of a batch.

    `moments` (3,) are the sums of those of :func:`weigh`; they are set to 0.
    """
    launch(noise_kernel, 1, [moments, rate, least], [noise])


@wp.kernel
def share_kernel(
    stride: int,
    first: int,
    last: int,
    patches: Patches,
    start: float,
    weight: float,
    # outputs
    share: wp.array3d[float],  # (N, h, w)
):
    """Average a patch and its neighbours."""
    height = share.shape[1]
    width = share.shape[2]
    for patch in range(first + wp.tid(), last, stride):
        view = patch // (height * width)
        i = (patch - view * height * width) // width
        j = patch - (view * height + i) * width
        total = int(0)
        count = int(0)
        for row in range(wp.max(i - 1, 0), wp.min(i + 2, height)):
            for column in range(wp.max(j - 1, 0), wp.min(j + 2, width)):
                total += patches.sums[view, row, column]
                count += patches.counts[view, row, column]
        found = (float(total) / UNIT + weight * start) / (float(count) + weight)
        share[view, i, j] = wp.clamp(found, 1.0 - start, start)


@wp.kernel
def forget_kernel(
    stride: int,
    first: int,
    last: int,
    most: int,
    # outputs
    sums: wp.array3d[int],  # (N, h, w)
    counts: wp.array3d[int],  # (N, h, w)
):
    """Halve the counts of a patch."""
    height = sums.shape[1]
    width = sums.shape[2]
    for patch in range(first + wp.tid(), last, stride):
        view = patch // (height * width)
        i = (patch - view * height * width) // width
        j = patch - (view * height + i) * width
        if counts[view, i, j] > most:
            sums[view, i, j] = sums[view, i, j] // 2
            counts[view, i, j] = counts[view, i, j] // 2


def settle(patches: codes.Patches, start: float, weight: float, most: int) -> None:
    """Compute the shares of patches from the counted rays; halve counts above `most`.

    Each share begins with as much as `weight` rays of the share `start`, which is also the largest;
    1 - `start` is the smallest.
    """
    count = int(patches.share.size)
    inputs = [struct_of(Patches, patches), start, weight]
    launch_each(share_kernel, count, 16 * count, inputs, [patches.share])
    launch_each(forget_kernel, count, 4 * count, [most], [patches.sums, patches.counts])
