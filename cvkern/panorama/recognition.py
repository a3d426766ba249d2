"""Grouping of an unordered set of images into panoramas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from cvkern._ahead import compiles_ahead
from cvkern.panorama.registration import (
    Progress,
    check_heap,
    connected,
    link_images,
    make_small,
)


class Recognition(NamedTuple):
    """The panoramas in an unordered set of images."""

    components: list[list[int]]
    """Indices of the images of each panorama, ascending. The largest panorama is first; among
    equal ones, the one with the least index. An image without partners is a component of one."""
    pairs: list[tuple[int, int]]
    """The pairs of images that overlap, i < j, ascending."""


@compiles_ahead("geometry.find_homographies", "features.match_images")
def recognize_panoramas(
    images: Sequence[Any],
    *,
    data_range: float | None = None,
    progress: Progress | None = None,
) -> Recognition:
    """Find which images of an unordered set belong to one panorama.

    The function matches the keypoints of all pairs of images and finds a homography for each pair.
    A pair is accepted if more than 8 + 0.3 n matches agree with its homography, where n is the
    number of all matches in the overlap. Images that accepted pairs connect form a panorama.

    Parameters
    ----------
    images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4)
        Images of any real dtypes and sizes. Images of more than 0.6 megapixels are reduced to that
        size for the comparison.
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.
    progress : function, optional
        Called with the number of completed steps, the number of all steps, and the name of the next
        one.

    Returns
    -------
    Recognition
        Named tuple of `components` and `pairs`.

    Raises
    ------
    TypeError
        If an image does not hold real numbers.
    ValueError
        If there are no images, one is empty or of another shape, `data_range` is not above 0, or
        the arrays are on several devices.

    References
    ----------
    .. [1] M. Brown and D. Lowe, "Automatic panoramic image stitching using invariant features",
       IJCV 74(1), 2007, section 3.2.

    Examples
    --------
    >>> from skimage import data
    >>> import cvkern
    >>> wide, other = data.coffee(), data.camera()
    >>> heap = [wide[:, :350], other, wide[:, 250:]]
    >>> cvkern.recognize_panoramas(heap)
    Recognition(components=[[0, 2], [1]], pairs=[(0, 2)])
    """
    heap = make_small(check_heap(images, data_range), data_range)
    links = link_images(heap, progress or silent)
    pairs = [(link.first, link.second) for link in links]
    return Recognition(connected(len(heap.images), pairs), pairs)


def silent(done: int, total: int, text: str) -> None:
    """Report nothing."""
