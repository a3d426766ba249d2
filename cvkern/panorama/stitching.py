"""Panoramas from an unordered set of images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._ahead import compiles_ahead
from cvkern._arrays import library
from cvkern._checks import MAX_ELEMENTS, check_integer
from cvkern._runtime import Runtime, runtime
from cvkern.panorama.blending import blend
from cvkern.panorama.cropping import largest_rectangle
from cvkern.panorama.drawing import Panorama, panorama_of, prepare
from cvkern.panorama.planning import (
    Options,
    Plan,
    check_focals,
    check_names,
    check_options,
    plan_panoramas,
)
from cvkern.panorama.recognition import silent
from cvkern.panorama.registration import Heap, Progress, check_heap, link_images, make_small

MAX_PIXELS = 100_000_000


@compiles_ahead("geometry.find_homographies", "features.match_images")
def stitch(
    images: Sequence[Any],
    *,
    surface: str = "auto",
    scale: float = 1.0,
    crop: bool = False,
    compensate: bool = True,
    bands: int | None = None,
    focal_lengths: Any = None,
    max_pixels: int = MAX_PIXELS,
    data_range: float | None = None,
    names: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> list[Panorama]:
    """Make every panorama of an unordered set of images.

    The images are grouped as by :func:`recognize_panoramas`. Bundle adjustment finds three angles
    and a focal length for each camera of a group that turned about one point, and how much their
    lens bends straight lines. It finds a homography for each image of one plane, such as the scans
    of a map. Then exposures are equalised, seams are laid around objects that moved, and each
    frequency band of the images is blended over a width of its own. Images that cannot be adjusted
    jointly are joined by the homographies of the best pairs, with a warning.

    Parameters
    ----------
    images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4)
        Images of one real dtype and of any sizes. A fourth channel is ignored.
    surface : {'auto', 'plane', 'cylinder', 'sphere'}, default 'auto'
        The surface for rotating cameras. 'auto' takes a plane for views of up to 90 degrees, corner
        to corner; else a cylinder for views of up to 50 degrees above and below the horizon; else
        a sphere. No plane holds more than 150 degrees: 'plane' then acts like 'auto'. Images of a
        plane are always drawn on a plane.
    scale : float, default 1.0
        Pixels of the panorama per pixel of an image, at least 1e-6.
    crop : bool, default False
        Cut the panorama to the largest rectangle without gaps.
    compensate : bool, default True
        Multiply each colour of each image by a gain that equalises the overlaps.
    bands : int, optional
        Number of times that images are halved for blending, at most 8; 0 gives hard seams. By
        default the smallest image is about 12 pixels wide.
    focal_lengths : array of shape (N,), optional
        Focal lengths of the images, in their pixels, if known to about 5 percent; NaN for unknown
        ones. They are refined, and ignored if the matches contradict them.
    max_pixels : int, default 100000000
        A larger panorama is refused before anything is drawn.
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.
    names : sequence of str, optional
        What messages call the images, such as their files. By default their indices.
    progress : function, optional
        Called with the number of completed steps, the number of all steps, and the name of the next
        one.

    Returns
    -------
    list of Panorama
        The panoramas, sorted by their number of images, largest first, then by their least index.
        Images without partners are left out.

    Raises
    ------
    TypeError
        If an image does not hold real numbers, or a name is no string.
    ValueError
        If there are no images, one is empty or of another shape, their dtypes differ, the arrays
        are on several devices, there are not as many `names`, an option is out of its range, or a
        panorama would have more than `max_pixels`.

    Warns
    -----
    UserWarning
        If images of a panorama could not be adjusted jointly.

    References
    ----------
    .. [1] M. Brown and D. Lowe, "Automatic panoramic image stitching using invariant features",
       IJCV 74(1), 2007.
    .. [2] P. Burt and E. Adelson, "A multiresolution spline with application to image mosaics",
       ACM Transactions on Graphics 2(4), 1983.

    Examples
    --------
    >>> from skimage import data
    >>> import cvkern
    >>> wide = data.coffee()
    >>> (panorama,) = cvkern.stitch([wide[:, 250:], data.camera()[..., None], wide[:, :350]])
    >>> panorama.members, panorama.surface, panorama.image.shape
    ([0, 2], 'plane', (400, 600, 3))
    """
    checked = check_heap(images, data_range)
    kinds = {library(image).dtype(image) for image in checked}
    if len(kinds) > 1:
        names = ", ".join(sorted(map(str, kinds)))
        raise ValueError(f"images must be of one dtype, got {names}")
    most = check_integer(max_pixels, "max_pixels", 1, MAX_ELEMENTS)
    options = check_options(surface, scale, crop, compensate, bands, most)
    focals = check_focals(focal_lengths, len(checked))
    called = check_names(names, len(checked))
    say = progress or silent
    heap = make_small(checked, data_range)
    plans = plan_panoramas(heap, link_images(heap, say), focals, options, called)
    rt = runtime(*checked)
    found = []
    for number, plan in enumerate(plans):
        text = f"Panorama {number + 1} of {len(plans)}"

        def part(done: float, number: int = number, text: str = text) -> None:
            say(2 * len(checked) + int(100 * (number + done)), 2 * len(checked) + 100 * len(plans),
                text)  # fmt: skip

        found.append(_drawn(rt, heap, plan, options, part))
    return found


def _drawn(rt: Runtime, heap: Heap, plan: Plan, options: Options, say: Any) -> Panorama:
    """Draw a planned panorama, crop it if asked, and describe it."""
    canvas = plan.canvas
    say(0.0)
    drawing = prepare(rt, heap, plan, options)
    shape, made = (canvas.height, canvas.width), drawing.made
    image, mask = rt.empty(shape + drawing.channels, made), rt.empty(shape, bool)
    blend(
        rt, canvas, drawing.seams, drawing.blend,
        rt.adopt(image, made, shape=(*shape, drawing.blend.channels)), rt.adopt(mask, bool),
        lambda done: say(0.2 + 0.8 * done),
    )  # fmt: skip
    image, mask = rt.release(image), rt.release(mask)
    if drawing.dtype == np.uint16 and isinstance(image, np.ndarray):
        image = image.astype(np.uint16)
    corner = 0, 0
    if options.crop:
        host = mask if isinstance(mask, np.ndarray) else rt.to_numpy(rt.adopt(mask, bool))
        top, left, bottom, right = largest_rectangle(np.asarray(host) != 0)
        of = library(image)
        image, mask = (of.contiguous(a[top:bottom, left:right], of.dtype(a)) for a in (image, mask))
        corner = top, left
    return panorama_of(plan, drawing, image, mask, corner)
