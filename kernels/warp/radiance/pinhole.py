"""Rays through the pixels of cameras, in Warp; one thread per ray."""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._random import random_index, random_unit
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.geometry._lens import straightened

from ._structs import CameraSet

wp.set_module_options({"enable_backward": False})

PIXEL = wp.constant(int(Draw.PIXEL))
PIXEL_Y = wp.constant(int(Draw.PIXEL_Y))
PIXEL_X = wp.constant(int(Draw.PIXEL_X))


@wp.func
def write_ray(
    poses: wp.array3d[float],
    lenses: wp.array2d[float],
    view: int,
    row: float,
    column: float,
    ray: int,
    origins: wp.array2d[float],
    directions: wp.array2d[float],
):
    """Store the origin and the unit direction of the ray through a pixel."""
    straight = straightened(lenses, view, row, column)
    x = straight[0]
    y = straight[1]
    ahead = wp.normalize(
        wp.vec3(
            poses[view, 0, 0] * x + poses[view, 0, 1] * y + poses[view, 0, 2],
            poses[view, 1, 0] * x + poses[view, 1, 1] * y + poses[view, 1, 2],
            poses[view, 2, 0] * x + poses[view, 2, 1] * y + poses[view, 2, 2],
        )
    )
    for k in range(3):
        origins[ray, k] = poses[view, k, 3]
        directions[ray, k] = ahead[k]


@wp.kernel
def view_rays_kernel(
    stride: int,
    first: int,
    last: int,
    cameras: CameraSet,
    view: int,
    begin: int,
    # outputs
    origins: wp.array2d[float],  # (R, 3)
    directions: wp.array2d[float],  # (R, 3)
):
    """Write the ray through a pixel of the view."""
    width = cameras.width
    for ray in range(first + wp.tid(), last, stride):
        pixel = begin + ray
        row = float(pixel // width)
        column = float(pixel % width)
        write_ray(cameras.poses, cameras.lenses, view, row, column, ray, origins, directions)


def view_rays(
    cameras: codes.CameraSet,
    view: int,
    begin: int,
    origins: wp.array,
    directions: wp.array,
) -> None:
    """Make rays (R, 3) through pixel centres of a view, in raster order, beginning at `begin`."""
    count = origins.shape[0]
    launch_each(
        view_rays_kernel,
        count,
        32 * count,
        [struct_of(CameraSet, cameras), view, begin],
        [origins, directions],
    )


@wp.struct
class Drawn:
    """Rays through random pixels, and the colours of these pixels."""

    origins: wp.array2d[float]  # (R, 3)
    directions: wp.array2d[float]  # (R, 3)
    targets: wp.array2d[float]  # (R, 4)
    views: wp.array[int]  # (R,)
    pixels: wp.array[int]  # (R,)


@wp.kernel
def random_rays_kernel(
    stride: int,
    first: int,
    last: int,
    cameras: CameraSet,
    images: wp.array2d[wp.uint8],  # (N H W, C)
    spread: float,
    seed: int,
    step: wp.array[int],  # (1,)
    chosen: wp.array[int],  # (V,)
    # outputs
    drawn: Drawn,
):
    """Write the ray through a random pixel."""
    width = cameras.width
    height = cameras.height
    every = chosen[0] < 0
    count = wp.where(every, images.shape[0], chosen.shape[0])
    for ray in range(first + wp.tid(), last, stride):
        pixel = random_index(seed, step[0], ray, PIXEL, count)
        if not every:
            pixel = chosen[pixel]
        view = pixel // (width * height)
        within = pixel - view * (width * height)
        row = within // width
        column = within - row * width
        y = float(row) + spread * (random_unit(seed, step[0], ray, PIXEL_Y) - 0.5)
        x = float(column) + spread * (random_unit(seed, step[0], ray, PIXEL_X) - 0.5)
        write_ray(cameras.poses, cameras.lenses, view, y, x, ray, drawn.origins, drawn.directions)
        for k in range(3):
            drawn.targets[ray, k] = float(images[pixel, k]) / 255.0
        opacity = float(1.0)
        if images.shape[1] == 4:
            opacity = float(images[pixel, 3]) / 255.0
        drawn.targets[ray, 3] = opacity
        drawn.views[ray] = view
        drawn.pixels[ray] = within


def random_rays(
    cameras: codes.CameraSet,
    images: wp.array,
    spread: float,
    seed: int,
    step: wp.array,
    chosen: wp.array,
    origins: wp.array,
    directions: wp.array,
    targets: wp.array,
    views: wp.array,
    pixels: wp.array,
) -> None:
    """Make rays (R, 3) through random pixels of all views, with the colours of these pixels.

    A ray goes through a random point of its pixel, `spread` pixels wide; 0 is the centre. `images`
    (N height width, 3 or 4) uint8 give `targets` (R, 4): the colour, and the opacity or 1. The
    pixels are drawn from the rows `chosen` (V,) of the images, or from all if the first one is
    negative. `views` (R,) are the photographs, and `pixels` (R,) the pixels within them.
    """
    count = origins.shape[0]
    launch_each(
        random_rays_kernel,
        count,
        64 * count,
        [struct_of(CameraSet, cameras), images, spread, seed, step, chosen],
        [struct_of(Drawn, (origins, directions, targets, views, pixels))],
    )
